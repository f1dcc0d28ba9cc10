// The triangles of a cell, compressed by Draco for Neuroglancer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "query/neuroglancer/cut_mesh.h"

namespace isonest::detail {

/// Whether this build has Draco.
bool has_draco();

/// Maximum number of triangles per fragment.
inline constexpr std::uint64_t kMaxInFragment = std::uint64_t{1} << 17U;
/// Maximum heap for compression, bytes: 150 per triangle were measured, for single voxels and
/// noise, with Draco 1.5.5.
inline constexpr std::uint64_t kFragmentHeap = std::uint64_t{32} << 20U;

/// A Draco mesh with the corners' positions as an attribute of three 32-bit integers, without
/// further rounding; corners at the same place are one vertex. It depends only on the triangles and
/// the version of Draco. Throws Error{limit} for more than kMaxInFragment, and Error{unsupported}
/// without Draco.
std::vector<std::byte> encode_fragment(std::span<const CellTriangle> triangles);

/// The eighths of the cell in which Neuroglancer finds triangles (a bit each, x lowest). Triangles
/// in a middle plane are drawn with the lower side. REQUIRES: no triangle crosses such a plane.
std::uint32_t eighths_of(std::span<const CellTriangle> triangles);

}  // namespace isonest::detail
