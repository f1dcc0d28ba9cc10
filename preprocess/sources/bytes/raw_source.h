// Raw numbers in a file, plain or gzip; also the data part of NRRD.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Whether the numbers are compressed: as their first bytes say (of a file that nothing describes),
/// or as a header says, which these must then agree with.
enum class Packing { recognised, plain, gzip, zlib, deflate };

/// Where and how the numbers lie: behind `start` bytes and `lines` lines of the file as it is
/// stored, and `offset` bytes of what is decompressed from there.
struct RawLayout {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::u8;
    bool big_endian = false;
    Packing packing = Packing::recognised;
    std::uint64_t start = 0;
    std::uint64_t lines = 0;
    std::uint64_t offset = 0;
    bool offset_from_end = false;  ///< the data are the last bytes of the file (not with gzip)
    bool exact_length = true;      ///< bytes behind the data are an error
    /// Of a larger array (components of a vector, time steps, another order of its axes): values
    /// from a node to the next along x, y and z, each > 0. None: x fastest, without gaps.
    std::optional<Int3> strides = {};
    std::uint64_t first = 0;  ///< values of that array before node (0, 0, 0)
    std::uint64_t whole = 0;  ///< values of that array; 0: as many as nodes
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin
    std::filesystem::path header;         ///< what describes them, if it is another file
};

/// Opens the numbers in `path`: the one place that decides where in a file they are. `name` is used
/// in messages.
/// Throws Error{not_found, io, invalid_argument} (the file's length does not fit: both byte
/// counts), Error{corrupt} (not packed as the layout says, fewer lines), Error{unsupported}.
std::unique_ptr<VolumeSource> open_raw(const std::filesystem::path& path, const std::string& name,
                                       const RawLayout& given);

/// `count` bytes from byte `at` on, or all where the file ends before. Throws Error{io}.
std::string first_bytes(const std::filesystem::path& path, std::size_t count, std::uint64_t at = 0);

/// Throws Error{not_found, invalid_argument, io} unless `path` is a readable regular file; gives
/// its size.
std::uint64_t regular_file_size(const std::filesystem::path& path);

/// Raw numbers, which the caller has to describe: it recognises every file.
VolumeFormat raw_format();

}  // namespace isonest::detail
