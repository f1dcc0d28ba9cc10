// The triangles of a cell as Draco packs them, for Neuroglancer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "query/neuroglancer/cut_mesh.h"

namespace isonest::detail {

/// Whether this build has Draco.
bool has_draco();

/// More triangles are not packed at once.
inline constexpr std::uint64_t kMostInFragment = std::uint64_t{1} << 17U;
/// Bytes of heap that packing needs, at most: 150 a triangle were measured, of single voxels and of
/// noise, with Draco 1.5.5.
inline constexpr std::uint64_t kFragmentHeap = std::uint64_t{32} << 20U;

/// A Draco mesh with the corners' places as an attribute of three 32-bit integers, which are not
/// rounded any more; corners in one place are one vertex. It is the same for the same triangles and
/// version of Draco. Throws Error{limit} for more than kMostInFragment, and Error{unsupported}
/// without Draco.
std::vector<std::byte> encode_fragment(std::span<const CellTriangle> triangles);

/// In which eighths of its cell Neuroglancer finds triangles, a bit each, that of x lowest: what
/// lies in a middle plane is drawn with the lower side. REQUIRES: none crosses such a plane.
std::uint32_t eighths_of(std::span<const CellTriangle> triangles);

}  // namespace isonest::detail
