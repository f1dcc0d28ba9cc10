// Numbers as they lie in a file, plain or in a stream of deflate.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// Opens the numbers in `path`: the one place that decides where in a file they are. `name` is used
/// in messages.
/// Throws Error{not_found, io, invalid_argument} (the file's length does not fit: both byte
/// counts), Error{corrupt} (not packed as the layout says, fewer lines), Error{unsupported}.
std::unique_ptr<VolumeSource> open_raw(const std::filesystem::path& path, const std::string& name,
                                       const RawLayout& given);

}  // namespace isonest::detail
