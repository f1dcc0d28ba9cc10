// The numbers of a Zarr array as they are stored, chunk by chunk.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include <isonest/volume_source.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/zarr/needed_nodes.h"
#include "preprocess/sources/zarr/zarr_files.h"
#include "preprocess/sources/zarr/zarr_image.h"

namespace isonest::detail {

/// The volume that was chosen of an array, neither mirrored nor scaled; float16 and integers of 64
/// bits as their bits (converted_source.h). As many threads decode as `max_heap` bytes allow. Nodes
/// that are not needed have the fill value where their whole chunk is not.
/// Throws Error{limit} where they do not hold one chunk.
std::unique_ptr<VolumeSource> zarr_chunks(std::shared_ptr<ZarrFiles> files, ZarrImage image,
                                          ChosenAxes chosen, Placement place,
                                          std::optional<LengthUnit> unit, std::uint64_t max_heap,
                                          const NeededNodes& needed, std::string name);

}  // namespace isonest::detail
