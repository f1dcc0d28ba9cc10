// Numbers as they lie in a file, plain or in a stream of deflate.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// Opens the numbers in `file`: the one place that decides where in a file they are. `name` is used
/// in messages.
/// Throws Error{not_found, io, invalid_argument} (the file's length does not fit: both byte
/// counts), Error{corrupt} (not packed as the layout says, fewer lines), Error{unsupported}.
std::unique_ptr<VolumeSource> open_raw(const InputFile& file, const std::string& name,
                                       const RawLayout& given);

/// The place behind `lines` lines from byte `at` of a file on. Throws Error{corrupt, io}.
std::uint64_t behind_lines(const InputFile& file, const std::string& name, std::uint64_t at,
                           std::uint64_t lines);

}  // namespace isonest::detail
