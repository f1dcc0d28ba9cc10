// Simplifies a whole mesh by successive mappings; out of core.
//
// The mesh is divided into blocks with locked borders. Each is simplified on its own (map_patch()).
// This is repeated with different borders, so that no seams remain. Passes exchange only the
// triangles with their displacements. query/DISTANCE.md explains why the bound holds.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_files.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/patch.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Simplifies a patch; each triangle has a bound of its distance from the full surface.
//
// Edges are collapsed one after another, those that change the surface least first, as long as no
// triangle is further than a distance from what it represents
// (query/simplify/collapse/star_mapping.h). The full surface is known only through the displacement
// of each triangle; query/DISTANCE.md, "By successive mappings", explains why that is sufficient.

/// Vertices are indices into `positions`; all triangles have the same orientation.
struct MappedPatch {
    std::vector<std::array<float, 3>> positions;  ///< world coordinates
    PatchBox box;
    /// Vertices that are also used by triangles outside the patch; they and the edges between them
    /// are kept.
    std::vector<bool> shared;
    /// For each vertex, the next copy of the same vertex in another sheet, in rings (SheetLines,
    /// query/simplify/collapse/sheet_mesh.h); empty: no sheets meet.
    std::vector<std::uint32_t> next_copy;
    /// The nodes that the surface must not pass over; default: none.
    std::optional<KeptNodes> kept_nodes;
    std::vector<PatchTriangle> triangles;
    std::vector<Displacement> displacements;  ///< of each triangle
    /// For each triangle: whether all edges at its corners have been tried within this limit.
    std::vector<bool> tried;
};

/// Maximum heap per triangle of a patch during map_patch(), not including the patch.
inline constexpr std::size_t kMapBytesPerTriangle = 400;

/// Removes triangles from `patch`. The remaining ones keep their order; unused vertices stay in
/// `positions`. Displacements that already exceed the limit are not changed. The topology is
/// preserved; where sheets meet, a vertex is removed from all of them. No
/// collapse folds an edge by more than 72 degrees and by more than before. Thread-safe.
GoneTriangles map_patch(MappedPatch& patch, const CollapseLimits& limits);

// Who maps the blocks of a mesh: the threads of this process, or those of all ranks
// (query/ranks/rank_mapping.h).

/// A block that is simplified on its own.
struct MappedBlock {
    MappedPatch patch;
    std::vector<std::uint64_t> vertex;  ///< number in the mesh, for each vertex of the patch
    GoneTriangles gone_at;
};

/// The blocks of one pass, numbered from 0.
struct BlockPass {
    std::int64_t blocks = 0;
    CollapseLimits limits;
    /// number of triangles in a block. Thread-safe
    std::function<std::uint64_t(std::int64_t block)> triangles;
    /// loads a block; called once for each. Thread-safe
    std::function<MappedBlock(std::int64_t block)> load;
    /// Receives a simplified block: triangles, displacements and tried of its patch, its vertex and
    /// gone_at. Called one at a time, in ascending order, possibly while others are loaded.
    std::function<void(std::int64_t block, const MappedBlock&)> use;
};

/// The result of map_patch() depends only on the block and the limits, so meshes are the same with
/// any implementation. Not thread-safe.
class BlockMapping {
  public:
    BlockMapping() = default;
    BlockMapping(const BlockMapping&) = delete;
    BlockMapping& operator=(const BlockMapping&) = delete;
    virtual ~BlockMapping() = default;

    /// Loads each block, maps it and passes it to `use`; the result is the same as with one thread.
    /// Works in the caller's arena. Reports the triangles of each block to `progress`. Throws
    /// Error{cancelled}, and what the functions of the pass throw.
    virtual void map(const BlockPass& pass, Progress& progress) = 0;
    /// No further pass follows soon; helpers may do something else.
    virtual void finish() {}
    /// Heap that it needs in addition to map_heap() for each thread.
    [[nodiscard]] virtual std::uint64_t heap() const { return 0; }
};

/// Mapping by the threads of this process. Thread-safe.
class LocalMapping : public BlockMapping {
  public:
    void map(const BlockPass& pass, Progress& progress) override;
};

/// Heap that one thread needs for a block.
std::uint64_t map_heap();

struct Mapped;

/// Distances are always measured from the full mesh with float32 vertices; the topology is
/// preserved; results do not depend on the number of threads. Not thread-safe; works in the
/// caller's arena, which has as many threads as there is memory for.
class MeshMapper {
  public:
    /// `mesh`: has the vertices of the full surface; it must outlive this object. `box`: to which
    /// the surface is clipped. REQUIRES: mesh.layout().corners == 3. Throws Error{io, cancelled},
    /// as all members do.
    MeshMapper(const ScratchMesh& mesh, const WorldLattice& lattice, const PatchBox& box,
               ScratchFolder folder, Progress& progress);
    /// For a mesh of sheets; call before the first result. `next_copies`: for each of its vertices
    /// (SheetMesh); must outlive this object. `margin`: no sheet passes over a node of the lattice,
    /// or comes closer to one than this, as a multiple of the distance between nodes; nothing: no
    /// restriction.
    void take_sheets(std::span<const std::uint64_t> next_copies, std::optional<double> margin) {
        next_copies_ = next_copies;
        margin_ = margin;
    }
    /// Sets who maps the blocks, default: the threads of this process. Call before the first
    /// result; the object must outlive this one.
    void map_by(BlockMapping& mapping) { mapping_ = &mapping; }
    ~MeshMapper();
    MeshMapper(const MeshMapper&) = delete;
    MeshMapper& operator=(const MeshMapper&) = delete;

    /// Called with indices of triangles that will not be read any more.
    using Consumed = std::function<void(std::uint64_t first, std::uint64_t count)>;
    /// `triangles` must outlive the result. With `consumed`, the result may be passed to within()
    /// once, and to nothing else.
    [[nodiscard]] Mapped full(const CornerView& triangles, Consumed consumed = {}) const;

    /// `limit`: world units, at least that of `from`, if it has one.
    [[nodiscard]] Mapped within(Mapped from, double limit) const;
    /// Simplifies in one run, with limits that rise from `first` to at most `most` (world units),
    /// until at most `triangles` are left (nearly as many, if there were more). The bound gives the
    /// resulting distance. If more triangles are left within `most`, the result has more.
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

/// The full mesh or one near it; its temporary files are removed with the last copy.
struct Mapped {
    std::shared_ptr<MeshMapper::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest displacement
    double limit = 0;  ///< limit of the mapping
};

}  // namespace isonest::detail
