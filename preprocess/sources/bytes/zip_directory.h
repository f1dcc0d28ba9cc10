// What a ZIP archive holds, and where.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace isonest::detail {

struct ZipMember {
    std::string name;
    bool deflated = false;     ///< else stored as it is
    std::uint64_t start = 0;   ///< of its data, in the archive
    std::uint64_t packed = 0;  ///< bytes in the archive
    std::uint64_t bytes = 0;   ///< unpacked
    std::uint32_t crc = 0;     ///< CRC-32 of what is unpacked
    bool readable = true;      ///< not encrypted, and of a method that is known
};

/// The archive's central directory, also of ZIP64.
/// Source: https://pkware.cachefly.net/webdocs/casestudies/APPNOTE.TXT
/// Throws Error{corrupt, unsupported, io}; more than 250,000 members are refused.
std::vector<ZipMember> read_zip_directory(const std::filesystem::path& path);

}  // namespace isonest::detail
