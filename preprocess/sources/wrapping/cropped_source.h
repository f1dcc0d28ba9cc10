// A part of a volume, or every n-th node of it.
#pragma once

#include <array>
#include <memory>

#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// Nodes [from, to) along x, y and z of `inner`, and of these every `every`-th, beginning with the
/// first. Only rows with such nodes are read, but as a whole; in a stream, the gaps are read and
/// dropped. Throws Error{invalid_argument} if nothing is left.
std::unique_ptr<VolumeSource> cropped(std::unique_ptr<VolumeSource> inner,
                                      const std::array<NodeRange, 3>& crop, const Int3& every);

// A source with reversed axes.

/// `inner` with each axis (x, y, z) reversed for which `backward` holds; spacing and origin stay.
/// Returns `inner` itself if there is no such axis. Throws Error{unsupported} if z is reversed and
/// the source is sequential.
std::unique_ptr<VolumeSource> mirrored(std::unique_ptr<VolumeSource> inner,
                                       const std::array<bool, 3>& backward);

}  // namespace isonest::detail
