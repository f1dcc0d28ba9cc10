// ZIP archives with entries that are too large for memory and are compressed by several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "store/files/output_file.h"

namespace isonest::detail {

/// A piece of an entry. It is independent of earlier pieces, so pieces can be made concurrently.
struct DeflatedPiece {
    std::vector<std::byte> bytes;
    std::uint64_t size = 0;  ///< of the uncompressed text
    std::uint32_t crc = 0;   ///< of the uncompressed text
};
/// Throws std::bad_alloc. REQUIRES: less than 1 GiB of text.
DeflatedPiece deflate_piece(std::string_view text);

/// Writes an archive into a file, one entry after another. Its bytes depend only on the pieces: it
/// contains no times. Uses ZIP64 only where necessary.
class ZipWriter {
  public:
    static constexpr std::uint64_t kMax32 = 0xFFFFFFFF;

    /// `file` must outlive it. Sizes from `most` on are written as ZIP64 (for tests: less than 2^32
    /// - 1).
    explicit ZipWriter(const OutputFile& file, std::uint64_t most = kMax32)
        : file_(&file), max_(most) {}
    /// REQUIRES: the last entry has ended; a name of ASCII characters.
    void begin_entry(std::string name);
    void add(const DeflatedPiece& piece);
    void add(std::string_view text) { add(deflate_piece(text)); }
    void end_entry();
    /// Writes the directory; nothing may follow. REQUIRES: the last entry has ended.
    void finish();

  private:
    struct Entry {
        std::string name;
        std::uint64_t place = 0;
        std::uint64_t size = 0;      ///< of the uncompressed text
        std::uint64_t deflated = 0;  ///< compressed size
        std::uint32_t crc = 0;
    };
    [[nodiscard]] bool is_large(const Entry& entry) const;
    void append(std::string_view bytes);

    const OutputFile* file_;
    std::uint64_t max_;
    std::uint64_t at_ = 0;
    std::vector<Entry> entries_;
};

}  // namespace isonest::detail
