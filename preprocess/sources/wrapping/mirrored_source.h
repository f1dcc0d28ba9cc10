// A source whose axes are turned around.
#pragma once

#include <array>
#include <memory>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// `inner` as if the axes (x, y, z) for which `backward` holds were stored from their other end on;
/// spacing and origin stay; itself where there is no such axis. Throws Error{unsupported} if z is
/// one and the source sequential.
std::unique_ptr<VolumeSource> mirrored(std::unique_ptr<VolumeSource> inner,
                                       const std::array<bool, 3>& backward);

}  // namespace isonest::detail
