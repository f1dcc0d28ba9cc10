// Keeps the vertices of a welded mesh apart, in its parts.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The triangles of a part that touch some vertices, and where their corners are.
struct TouchedInPart {
    std::vector<ElementCorners> triangles;
    std::vector<std::array<std::array<float, 3>, 3>> at;
};
/// `touches`(number): whether a vertex is one of those, which are among PartStore::not_alone().
TouchedInPart touched_in(const PartStore& parts, const PartRecord& r, const VertexNumbers& weld,
                         const std::function<bool(std::uint64_t)>& touches);

/// Moves the vertices to where they are now, in all parts: each part has its own copy of a vertex,
/// and watches it as the others do. Sorts `vertices` by number.
void put_back(PartStore& parts, const VertexNumbers& weld, std::span<PlacedVertex> vertices);

/// `range`: its box is not looked at, that of the parts holds. What grows with the mesh lies in
/// temporary files in `folder`. REQUIRES: PartStore::watch() was called, and no triangle is without
/// area. Throws Error{io, cancelled}.
ApartVertices keep_parts_apart(PartStore& parts, const VertexNumbers& weld, ApartRange range,
                               const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
