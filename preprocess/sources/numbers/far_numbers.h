// Numbers that lie in an object elsewhere, plain, in any order of their axes.
#pragma once

#include <memory>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// By ranges, announced ahead. REQUIRES: file.is_far(); not compressed; the layout's offset is the
/// object's, and the array lies in it. Throws Error{unsupported} where what a slab needs lies in
/// pieces so small and so many that all of the object would be fetched again for each slab, or in
/// more requests than can be.
std::unique_ptr<VolumeSource> open_far_numbers(const InputFile& file, const std::string& name,
                                               const RawLayout& layout);

}  // namespace isonest::detail
