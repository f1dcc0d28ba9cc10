#include "query/simplify/mapping/map_mesh.h"

#include <algorithm>
#include <cmath>

#include "query/simplify/block_items.h"
#include "query/simplify/block_patch.h"
#include "query/simplify/mapping/star_mapping.h"
#include "query/simplify/packed_triangle.h"

namespace isonest::detail {
namespace {

/// Triangles in a block.
constexpr std::uint32_t kMostInBlock = 1U << 14U;
constexpr int kPasses = 3;

/// Makes the patch of a block, triangle by triangle.
class PatchMaker {
  public:
    PatchMaker(const ScratchMesh& mesh, const PatchBox& box, std::uint64_t triangles)
        : numbering_(mesh, numbered_) {
        block_.patch.box = box;
        block_.patch.triangles.reserve(triangles);
        block_.patch.displacements.reserve(triangles);
        block_.patch.tried.reserve(triangles);
    }
    void add(const ElementCorners& corners, const Displacement& displacement, bool tried) {
        block_.patch.triangles.push_back(numbering_.local(corners));
        block_.patch.displacements.push_back(displacement);
        block_.patch.tried.push_back(tried);
    }
    /// All of it, once. `next_copies`: of the mesh's vertices, or none.
    MappedBlock finish(const Valences& valences, std::span<const std::uint64_t> next_copies) {
        MappedPatch& patch = block_.patch;
        patch.positions = std::move(numbered_.patch.positions);
        block_.vertex = std::move(numbered_.vertex);
        patch.shared = shared_vertices(valences, block_.vertex, patch.triangles);
        if (!next_copies.empty()) {
            link_copies(next_copies);
        }
        return std::move(block_);
    }

  private:
    /// Rings of those copies that are in the patch, which are shared where not all are.
    void link_copies(std::span<const std::uint64_t> next_copies) {
        MappedPatch& patch = block_.patch;
        patch.next_copy.resize(block_.vertex.size());
        for (std::uint32_t v = 0; v < block_.vertex.size(); ++v) {
            std::uint64_t copy = next_copies[block_.vertex[v]];
            std::uint32_t next = numbering_.number_of(copy);
            while (next == kNoVertex) {
                patch.shared[v] = true;
                copy = next_copies[copy];
                next = numbering_.number_of(copy);
            }
            patch.next_copy[v] = next;
        }
    }

    BlockPatch numbered_;
    PatchNumbering numbering_;
    MappedBlock block_;
};

}  // namespace

std::uint64_t map_heap() {
    return std::uint64_t{kMostInBlock} * 2 * kMapBytesPerTriangle;
}

struct MeshMapper::Run {
    explicit Run(const ScratchFolder& folder) : full(folder), mesh(folder) {}

    CornerView triangles;  ///< the full surface; else none
    Consumed consumed;     ///< of these
    BlockRuns full;        ///< of these
    BlockItems<PackedTriangle> mesh;
    std::uint32_t blocks = 0;  ///< 0: nothing was sorted until now
    int third = 0;             ///< the shift of the blocks that they are sorted into
    double bound = 0;

    [[nodiscard]] std::uint64_t count() const {
        return triangles.empty() ? mesh.count() : triangles.size();
    }
    [[nodiscard]] std::uint64_t count_in(std::uint32_t block) const {
        std::uint64_t count = mesh.count_in(block);
        for (const BlockRun& run : full.of(block)) {
            count += run.count;
        }
        return count;
    }
    template <class Visit>
    void each(const Visit& visit) const {
        for (const ElementCorners t : triangles) {
            visit(t);
        }
        for (const PackedTriangle& t : mesh.all()) {
            visit(t.corners());
        }
    }
    /// Nobody will look at a block any more.
    void consume(std::uint32_t block) {
        if (triangles.empty()) {
            mesh.consume(block);
        } else if (consumed) {
            for (const BlockRun& run : full.of(block)) {
                consumed(run.first, run.count);
            }
        }
    }
};

MeshMapper::MeshMapper(const ScratchMesh& mesh, const WorldLattice& lattice, const PatchBox& box,
                       ScratchFolder folder, Progress& progress)
    : mesh_(mesh),
      lattice_(lattice),
      box_(box),
      folder_(std::move(folder)),
      progress_(progress),
      mapping_(&local_) {}

MeshMapper::~MeshMapper() = default;

Mapped MeshMapper::full(const CornerView& triangles, Consumed consumed) const {
    auto run = std::make_shared<Run>(folder_);
    run->triangles = triangles;
    run->consumed = std::move(consumed);
    run->mesh.seal();
    return {run, run->count(), 0, 0};
}

void MeshMapper::append(Run& run, const MappedBlock& block) {
    for (std::size_t i = 0; i < block.patch.triangles.size(); ++i) {
        const PatchTriangle& t = block.patch.triangles[i];
        const Displacement& d = block.patch.displacements[i];
        run.mesh.append({{block.vertex[t[0]], block.vertex[t[1]], block.vertex[t[2]]},
                         static_cast<std::uint16_t>(block.patch.tried[i] ? 1 : 0),
                         d});
        run.bound = std::max(run.bound, d.bound());
    }
}

/// Into blocks of their own.
void MeshMapper::sort(Run& run) const {
    BlockGrid grid(lattice_, mesh_, run.third, folder_);
    run.each([&](const ElementCorners& t) { grid.count(t); });
    progress_.check();
    grid.divide(kMostInBlock);
    for (const ElementCorners t : run.triangles) {
        run.full.add(grid.block_of(t));
    }
    for (const PackedTriangle& t : run.mesh.all()) {
        run.mesh.add_block(grid.block_of(t.corners()));
    }
    progress_.check();
    run.blocks = std::max(grid.blocks(), 1U);
    run.full.sort(run.blocks);
    run.mesh.sort(run.blocks);
}

MappedBlock MeshMapper::load(const Run& run, const Valences& valences, std::uint32_t block,
                             bool afresh) const {
    PatchMaker maker(mesh_, box_, run.count_in(block));
    for (const BlockRun& full : run.full.of(block)) {
        for (const ElementCorners t : run.triangles.subspan(full.first, full.count)) {
            maker.add(t, {}, false);
        }
    }
    run.mesh.each(block, [&](const PackedTriangle& t) {
        maker.add(t.corners(), t.displacement, !afresh && t.mark != 0);
    });
    MappedBlock made = maker.finish(valences, next_copies_);
    if (margin_) {
        made.patch.kept_nodes = KeptNodes{lattice_, *margin_};
    }
    return made;
}

/// `afresh`: what was tried was so within another limit. `is_last`: nobody will look at `from` any
/// more.
std::shared_ptr<MeshMapper::Run> MeshMapper::pass(Run& from, const CollapseLimits& limits,
                                                  bool afresh, bool is_last,
                                                  GoneTriangles* gone) const {
    if (from.blocks == 0) {
        sort(from);
    }
    auto next = std::make_shared<Run>(folder_);
    next->third = (from.third + 1) % kBlockShifts;
    Valences valences(mesh_.layout().vertices, folder_);
    from.each([&](const ElementCorners& t) { valences.count(t); });
    progress_.begin("simplify", from.count(), "triangles");
    BlockPass blocks;
    blocks.blocks = from.blocks;
    blocks.limits = limits;
    blocks.triangles = [&](std::int64_t i) { return from.count_in(static_cast<std::uint32_t>(i)); };
    blocks.load = [&](std::int64_t i) {
        return load(from, valences, static_cast<std::uint32_t>(i), afresh);
    };
    blocks.use = [&](std::int64_t i, const MappedBlock& block) {
        append(*next, block);
        if (gone != nullptr) {
            add_gone(*gone, block.gone_at);
        }
        if (is_last) {
            from.consume(static_cast<std::uint32_t>(i));
        }
    };
    mapping_->map(blocks, progress_);
    next->mesh.seal();
    return next;
}

Mapped MeshMapper::within(Mapped from, double limit) const {
    bool afresh = from.limit != limit;
    for (int i = 0; i < kPasses; ++i) {
        // Others may have the first one, too.
        const bool is_last = i > 0 || from.run->consumed;
        from.run = pass(*from.run, limits_of(limit, kFurthestMapped), afresh, is_last);
        afresh = false;
    }
    return {from.run, from.run->count(), from.run->bound, limit};
}

Mapped MeshMapper::down_to(const Mapped& from, std::uint64_t triangles, double first,
                           double most) const {
    Mapped mapped = from;
    constexpr double kFactor = 2;
    for (double limit = std::min(first, most); mapped.triangles > triangles;
         limit = std::min(limit * kFactor, most)) {
        GoneTriangles gone;
        const CollapseLimits limits = limits_of(limit, kFurthestMapped);
        std::shared_ptr<Run> run = pass(*mapped.run, limits, true, false, &gone);
        const bool is_enough = run->count() <= triangles;
        if (is_enough) {
            // Again, up to the estimate at which there are just few enough.
            run = pass(*mapped.run, up_to(limits, gone, mapped.triangles, triangles), true, false);
        }
        const bool is_last = limit >= most && run->count() >= mapped.triangles;
        mapped = {run, run->count(), run->bound, limit};
        if (is_enough || is_last) {
            break;
        }
    }
    return mapped;
}

CornerFile MeshMapper::corners(const Mapped& of) const {
    return corner_file(folder_, mesh_.layout().vertices, of.triangles,
                       [&](const auto& visit) { of.run->each(visit); });
}

}  // namespace isonest::detail
