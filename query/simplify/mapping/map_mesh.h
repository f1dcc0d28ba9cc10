// Fewer triangles for a whole mesh by successive mappings; out of core.
//
// The mesh is cut into blocks with locked borders, each of which is simplified by itself
// (query/simplify/mapping/map_patch.h); then once more with other borders, so that no seams stay.
// From one pass to the next go the triangles, each with its displacement, and nothing else. The
// argument why the bound holds is in query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/block_patch.h"
#include "query/simplify/mapping/block_mapping.h"
#include "query/simplify/mapping/map_patch.h"
#include "query/simplify/patch.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Heap that one thread needs for a block.
std::uint64_t map_heap();

struct Mapped;

/// Distances are always from the full mesh, as its vertices are in float32; the topology stays; the
/// results are the same for any number of threads. Not thread-safe; it works in the arena of its
/// caller, which has as many threads as there is memory for.
class MeshMapper {
  public:
    /// `mesh`: has the vertices of the full surface, and has to stay. `box`: to which the surface
    /// is cut. REQUIRES: mesh.layout().corners == 3. Throws Error{io, cancelled}, as all members
    /// do.
    MeshMapper(const ScratchMesh& mesh, const WorldLattice& lattice, const PatchBox& box,
               ScratchFolder folder, Progress& progress);
    /// Before the first result. Of a mesh of sheets: `next_copies` of each of its vertices
    /// (SheetMesh), which have to stay. `margin`: no sheet passes over a node of the lattice, or
    /// comes so near to one, in distances between nodes; nothing: they may.
    void take_sheets(std::span<const std::uint64_t> next_copies, std::optional<double> margin) {
        next_copies_ = next_copies;
        margin_ = margin;
    }
    /// Before the first result: who maps the blocks, which has to stay; else the threads of this
    /// process do.
    void map_by(BlockMapping& mapping) { mapping_ = &mapping; }
    ~MeshMapper();
    MeshMapper(const MeshMapper&) = delete;
    MeshMapper& operator=(const MeshMapper&) = delete;

    /// Is told of triangles, by their places, that nobody will look at any more.
    using Consumed = std::function<void(std::uint64_t first, std::uint64_t count)>;
    /// `triangles` have to stay as long as the result. With `consumed`, within() takes the result
    /// once, and nothing else does.
    [[nodiscard]] Mapped full(const CornerView& triangles, Consumed consumed = {}) const;

    /// `limit`: world units, at least that of `from`, if it has one.
    [[nodiscard]] Mapped within(Mapped from, double limit) const;
    /// In one run, by limits that rise from `first` to at most `most` (world units), until no more
    /// than `triangles` are left; nearly as many, if there were more. The bound says how far that
    /// is. More are left if there are more within `most`.
    [[nodiscard]] Mapped down_to(const Mapped& from, std::uint64_t triangles, double first,
                                 double most) const;
    [[nodiscard]] CornerFile corners(const Mapped& of) const;

  private:
    friend struct Mapped;
    struct Run;
    std::shared_ptr<Run> pass(Run& from, const CollapseLimits& limits, bool afresh, bool is_last,
                              GoneTriangles* gone = nullptr) const;
    [[nodiscard]] MappedBlock load(const Run& run, const Valences& valences, std::uint32_t block,
                                   bool afresh) const;
    static void append(Run& run, const MappedBlock& block);
    void sort(Run& run) const;

    const ScratchMesh& mesh_;
    std::span<const std::uint64_t> next_copies_;
    std::optional<double> margin_;
    WorldLattice lattice_;
    PatchBox box_;
    ScratchFolder folder_;
    Progress& progress_;
    LocalMapping local_;
    BlockMapping* mapping_;
};

/// A mesh near to the full one, or that itself; its temporary files go with the last copy.
struct Mapped {
    std::shared_ptr<MeshMapper::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest displacement
    double limit = 0;  ///< within which it was mapped
};

}  // namespace isonest::detail
