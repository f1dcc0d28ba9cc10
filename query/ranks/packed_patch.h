// Patches as bytes, for messages between ranks.
//
// Numbers have the bytes that they have in memory: all ranks run the same program. A patch takes
// about 13 bytes for each triangle of the full surface, and 41 for one that was simplified before.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "query/simplify/mapping/block_mapping.h"

namespace isonest::detail {

/// In front of what is packed: its bytes, as std::uint64_t, with these.
inline constexpr std::size_t kPackedHead = 8;

/// Most bytes for each triangle of a patch, if no two share a vertex, and of what is left of it,
/// beside a few for each block and those of gone_at.
inline constexpr std::size_t kMostPackedPatch = 89;
inline constexpr std::size_t kMostPackedResult = 41;

/// All of it, to the last bit. Thread-safe, as the others are.
std::vector<std::byte> packed_patch(const MappedPatch& patch);
/// Throws std::logic_error if these are not the bytes of a patch.
MappedPatch unpacked_patch(std::span<const std::byte> bytes);

/// What map_patch() has changed: triangles, displacements and tried, and what it has returned.
std::vector<std::byte> packed_result(const MappedPatch& patch, const GoneTriangles& gone_at);
/// Puts that into a block, whose vertices are left alone.
void unpack_result(std::span<const std::byte> bytes, MappedBlock& block);

}  // namespace isonest::detail
