// Part of an array in a file, in any order of its axes.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// What memory can show, a map of the file can. REQUIRES: not compressed; the layout's strides are
/// given, its offset is the file's, and the array lies in the file. Throws Error{io}.
std::unique_ptr<VolumeSource> open_strided(const std::filesystem::path& path,
                                           const std::string& name, const RawLayout& layout);

}  // namespace isonest::detail
