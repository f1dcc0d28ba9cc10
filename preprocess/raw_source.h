// Raw numbers in a file, plain or gzip; also the data part of NRRD.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "preprocess/volume_source.h"

namespace isonest {

/// Where and how the numbers lie.
struct RawLayout {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::u8;
    bool big_endian = false;
    std::uint64_t offset = 0;      ///< bytes before the data, of the decompressed stream
    bool offset_from_end = false;  ///< the data are the last bytes of the file (not with gzip)
    bool exact_length = true;      ///< bytes behind the data are an error
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    std::filesystem::path header;  ///< what describes them, if it is another file
};

/// Opens the numbers in `path`; gzip is recognised by its magic. `name` is used in messages.
/// Throws Error{not_found, io, invalid_argument} (the file's length does not fit: both byte
/// counts).
std::unique_ptr<VolumeSource> open_raw(const std::filesystem::path& path, const std::string& name,
                                       const RawLayout& given);

/// A gzip stream that starts `skip` bytes into the file (attached NRRD). Offsets as in open_raw().
std::unique_ptr<VolumeSource> open_gzip_behind(const std::filesystem::path& path,
                                               const std::string& name, std::uint64_t skip,
                                               const RawLayout& layout);

/// The first `count` bytes, or all where the file is shorter. Throws Error{io}.
std::string first_bytes(const std::filesystem::path& path, std::size_t count);
/// True if the file starts with gzip's magic. Throws Error{io}.
bool is_gzip(const std::filesystem::path& path);

/// Throws Error{not_found, invalid_argument, io} unless `path` is a readable regular file; gives
/// its size.
std::uint64_t regular_file_size(const std::filesystem::path& path);

}  // namespace isonest
