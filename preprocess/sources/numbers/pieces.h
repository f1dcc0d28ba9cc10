// Numbers that lie in several files, one after the other, as a volume.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// At most so many files are one volume.
inline constexpr std::uint64_t kMostPieces = 100000;

/// Whether a name has one place for a number, as "slice%03d.raw" has: a % and a d, with up to two
/// digits between them.
bool is_numbered(const std::string& pattern);

/// The names that a pattern gives for numbers from `first` to `last` in steps of `step`, which may
/// be negative; none where it is no pattern or no such numbers are, and where there are more than
/// kMostPieces.
std::vector<std::string> numbered_names(const std::string& pattern, std::int64_t first,
                                        std::int64_t last, std::int64_t step);

/// The files of these names beside `header`. Throws Error{unsupported} for what is elsewhere.
std::vector<InputFile> pieces_beside(const InputFile& header,
                                     const std::vector<std::string>& names);

/// The bytes of all files, each of which has `piece` bytes of numbers where `layout` says (packing,
/// start, lines, offset, offset_from_end): plain ones or streams of gzip or zlib. Looks at all
/// files. Throws Error{not_found, io, invalid_argument}, which name the file.
std::unique_ptr<ByteReader> bytes_of_pieces(const std::vector<InputFile>& files,
                                            const RawLayout& layout, std::uint64_t piece);

}  // namespace isonest::detail
