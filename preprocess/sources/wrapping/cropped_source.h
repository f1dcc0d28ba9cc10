// A part of a volume, or each n-th node of it.
#pragma once

#include <array>
#include <memory>

#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// Nodes [from, to) along x, y and z of `inner`, and of these each `every`-th from the first on.
/// Only rows with such nodes are read, but those whole; the gaps of a stream are read over.
/// Throws Error{invalid_argument} where nothing is left.
std::unique_ptr<VolumeSource> cropped(std::unique_ptr<VolumeSource> inner,
                                      const std::array<NodeRange, 3>& crop, const Int3& every);

}  // namespace isonest::detail
