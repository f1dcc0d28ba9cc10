// Fewer triangles for a whole mesh by successive mappings; out of core.
//
// The mesh is cut into blocks with locked borders, each of which is simplified by itself
// (query/simplify/mapping/map_patch.h); then once more with other borders, so that no seams stay.
// From one pass to the next go the triangles, each with its displacement, and nothing else. The
// argument why the bound holds is in query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/block_patch.h"
#include "query/simplify/mapping/map_patch.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// Heap that one thread needs for a block.
std::uint64_t map_heap();

/// Triangles in a block that use the time and the heap well.
std::uint64_t mapped_at_a_time();

struct Mapped;

/// A part of a full surface that was simplified by itself.
struct MappedBlock {
    MappedPatch patch;
    std::vector<std::uint64_t> vertex;  ///< of the mesh, for each one of the patch
    GoneTriangles gone_at;
};

/// Distances are always from the full mesh, as its vertices are in float32; the topology stays; the
/// results are the same for any number of threads. Not thread-safe but for map(); it works in the
/// arena of its caller, which has as many threads as there is memory for.
///
/// The full surface comes as a whole, by full(), or in parts, by map() and add() for each and
/// whole() at last: then no more of it is on the disk at a time than is left of it.
class MeshMapper {
  public:
    /// `mesh`: has the vertices of the full surface, and has to stay. `box`: to which the surface
    /// is cut. REQUIRES: mesh.layout().corners == 3. Throws Error{io, cancelled}, as all members
    /// do.
    MeshMapper(const ScratchMesh& mesh, const WorldLattice& lattice, const PatchBox& box,
               std::filesystem::path folder, Progress& progress);
    ~MeshMapper();
    MeshMapper(const MeshMapper&) = delete;
    MeshMapper& operator=(const MeshMapper&) = delete;

    /// `triangles` have to stay as long as the result.
    [[nodiscard]] Mapped full(std::span<const ElementCorners> triangles);

    /// A part of the full surface within `limit` (world units). `is_shared`: whether triangles that
    /// are not in the part have a vertex, too. Thread-safe.
    [[nodiscard]] MappedBlock map(std::span<const ElementCorners> triangles,
                                  const std::function<bool(std::uint64_t)>& is_shared,
                                  double limit) const;
    /// In the same order always.
    void add(const MappedBlock& block);
    /// All that was added. `limit`: that of its parts.
    [[nodiscard]] Mapped whole(double limit);

    /// `limit`: world units, at least that of `from`, if it has one.
    Mapped within(const Mapped& from, double limit);
    /// In one run, by limits that rise from `first` to at most `most` (world units), until no more
    /// than `triangles` are left; nearly as many, if there were more. The bound says how far that
    /// is. More are left if there are more within `most`.
    Mapped down_to(const Mapped& from, std::uint64_t triangles, double first, double most);
    /// An array of ElementCorners.
    [[nodiscard]] ScratchFile corners(const Mapped& of) const;
    /// Bytes of temporary files at a time, at most.
    [[nodiscard]] std::uint64_t scratch_bytes() const { return scratch_bytes_; }

  private:
    friend struct Mapped;
    struct Run;
    std::shared_ptr<Run> pass(const Run& from, const CollapseLimits& limits, bool afresh,
                              GoneTriangles* gone = nullptr);
    [[nodiscard]] MappedBlock load(const Run& run, const Valences& valences, std::uint32_t block,
                                   bool afresh) const;
    static void append(Run& run, const MappedBlock& block);
    void sort(Run& run);

    const ScratchMesh& mesh_;
    WorldLattice lattice_;
    PatchBox box_;
    std::filesystem::path folder_;
    Progress& progress_;
    std::shared_ptr<Run> added_;  ///< in parts
    std::uint64_t scratch_bytes_ = 0;
};

/// A mesh near to the full one, or that itself; its temporary files go with the last copy.
struct Mapped {
    std::shared_ptr<const MeshMapper::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest displacement
    double limit = 0;  ///< within which it was mapped
};

}  // namespace isonest::detail
