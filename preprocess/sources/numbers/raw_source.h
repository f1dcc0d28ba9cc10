// Numbers stored in one file or in several, or made by a ByteReader.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_rows.h"

namespace isonest::detail {

// Numbers in a file, plain or in a deflate stream.

/// Opens the numbers in `file`. This is the only place that decides where in a file they are.
/// `name` is used in messages.
/// Throws Error{not_found, io, invalid_argument} (the file's length does not match: the message has
/// both byte counts), Error{corrupt} (not compressed as the layout says, too few lines),
/// Error{unsupported}.
std::unique_ptr<VolumeSource> open_raw(const InputFile& file, const std::string& name,
                                       const RawLayout& given);

/// The position after `lines` lines from byte `at` of a file. Throws Error{corrupt, io}.
std::uint64_t behind_lines(const InputFile& file, const std::string& name, std::uint64_t at,
                           std::uint64_t lines);

// Numbers whose bytes come from a ByteReader, as a volume.

/// The numbers of a layout (without packing, lines and offset_from_end) in these bytes. `file` is
/// the file that they are made from. Throws Error{invalid_argument} if there are too few bytes, and
/// Error{unsupported} for an axis order that a sequential reader cannot provide.
std::unique_ptr<VolumeSource> open_bytes(std::unique_ptr<ByteReader> bytes, const std::string& name,
                                         const RawLayout& layout, const InputFile& file);

// Part of an array in a file, with any axis order.

/// Memory-maps the file. REQUIRES: not compressed; the layout's strides are given, its offset is
/// relative to the file, and the array lies in the file. Throws Error{io}.
std::unique_ptr<VolumeSource> open_strided(const std::filesystem::path& path,
                                           const std::string& name, const RawLayout& layout);

// Numbers in several files, one after the other, as one volume.

/// Maximum number of files of one volume.
inline constexpr std::uint64_t kMaxPieces = 100000;

/// Whether a name contains one placeholder for a number, like "slice%03d.raw": a % and a d, with up
/// to two digits between them.
bool is_numbered(const std::string& pattern);

/// The names that a pattern gives for the numbers from `first` to `last` in steps of `step`, which
/// may be negative. Empty if it is not a pattern, if there are no such numbers, or more than
/// kMaxPieces.
std::vector<std::string> numbered_names(const std::string& pattern, std::int64_t first,
                                        std::int64_t last, std::int64_t step);

/// The files of these names beside `header`. Throws Error{unsupported} for remote files.
std::vector<InputFile> pieces_beside(const InputFile& header,
                                     const std::vector<std::string>& names);

/// The bytes of all files. Each has `piece` bytes of numbers where `layout` says (packing, start,
/// lines, offset, offset_from_end): plain, or gzip or zlib streams. Checks all files. Throws
/// Error{not_found, io, invalid_argument}, which name the file.
std::unique_ptr<ByteReader> bytes_of_pieces(const std::vector<InputFile>& files,
                                            const RawLayout& layout, std::uint64_t piece);

}  // namespace isonest::detail
