// A volume with periodic axes.
#pragma once

#include <array>
#include <memory>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// `inner`, repeated along its periodic axes (x, y, z): `repeat` periods of its nodes, and the
/// first nodes once more, so that the cells between the last nodes and the first are in the volume.
/// Returns `inner` itself if no axis is periodic. Throws Error{invalid_argument} for more than one
/// period along another axis or a periodic axis of one node, Error{limit} if there would be too
/// many nodes, and Error{unsupported} if z is periodic and the source is sequential.
std::unique_ptr<VolumeSource> repeated(std::unique_ptr<VolumeSource> inner,
                                       const std::array<bool, 3>& periodic, const Int3& repeat);

}  // namespace isonest::detail
