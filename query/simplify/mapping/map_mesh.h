// Fewer triangles for a whole mesh by successive mappings; out of core.
//
// The mesh is cut into blocks with locked borders, each of which is simplified by itself
// (query/simplify/mapping/map_patch.h); then once more with other borders, so that no seams stay.
// From one pass to the next go the triangles, each with its displacement, and nothing else. The
// argument why the bound holds is in query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/mapping/map_patch.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// Heap that one thread needs for a block.
std::uint64_t map_heap();

struct Mapped;

/// Distances are always from the full mesh, as its vertices are in float32; the topology stays; the
/// results are the same for any number of threads. Not thread-safe; it works in the arena of its
/// caller, which has as many threads as there is memory for.
class MeshMapper {
  public:
    /// `triangles`: the full surface, whose corners are vertices of `mesh`, which has to stay.
    /// `box`: to which it is cut.
    /// REQUIRES: mesh.layout().corners == 3. Throws Error{io, cancelled}, as all members do.
    MeshMapper(const ScratchMesh& mesh, std::span<const ElementCorners> triangles,
               const WorldLattice& lattice, const PatchBox& box, std::filesystem::path folder,
               Progress& progress);
    ~MeshMapper();
    MeshMapper(const MeshMapper&) = delete;
    MeshMapper& operator=(const MeshMapper&) = delete;

    [[nodiscard]] Mapped full() const;
    /// `limit`: world units, > 0.
    Mapped within(const Mapped& from, double limit);
    /// In one run, by limits that rise from `first` to at most `most` (world units), until no more
    /// than `triangles` are left; nearly as many, if there were more. The bound says how far that
    /// is. More are left if there are more within `most`.
    Mapped down_to(std::uint64_t triangles, double first, double most);
    /// An array of ElementCorners.
    [[nodiscard]] ScratchFile corners(const Mapped& of) const;
    /// Bytes of temporary files at a time, at most.
    [[nodiscard]] std::uint64_t scratch_bytes() const { return scratch_bytes_; }

  private:
    friend struct Mapped;
    struct Run;
    struct Collapses;
    std::shared_ptr<Run> pass(const Run& from, const MappingLimits& limits, bool afresh,
                              Collapses* collapses = nullptr);
    void sort(Run& run);

    const ScratchMesh& mesh_;
    WorldLattice lattice_;
    PatchBox box_;
    std::filesystem::path folder_;
    Progress& progress_;
    std::shared_ptr<Run> full_;
    std::uint64_t scratch_bytes_ = 0;
};

/// A mesh near to the full one; its temporary files go with the last copy.
struct Mapped {
    std::shared_ptr<const MeshMapper::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest displacement
};

}  // namespace isonest::detail
