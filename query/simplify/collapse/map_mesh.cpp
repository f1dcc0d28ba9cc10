#include "query/simplify/collapse/map_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "query/simplify/block_files.h"
#include "query/simplify/collapse/line_collapse.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/collapse/star_mapping.h"
#include "store/base/in_order.h"

namespace isonest::detail {

void LocalMapping::map(const BlockPass& pass, Progress& progress) {
    in_order(
        pass.blocks, tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress.check();
            MappedBlock block = pass.load(i);
            const std::size_t count = block.patch.triangles.size();
            block.gone_at = map_patch(block.patch, pass.limits);
            progress.advance(count);
            return block;
        },
        pass.use);
}

namespace {

class PatchMapper {
  public:
    PatchMapper(MappedPatch& patch, const CollapseLimits& limits)
        : patch_(patch),
          limit_(limits.distance),
          locked_(patch.shared),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          lines_(patch.next_copy, locked_),
          queue_(patch.positions, mesh_, limits.square_estimate),
          collapse_(patch.positions, patch.box, patch.shared, lines_.known(), mesh_),
          mapping_(patch.displacements),
          line_(patch.positions, lines_, locked_, mesh_, collapse_, mapping_) {
        if (patch.kept_nodes) {
            nodes_.emplace(*patch.kept_nodes);
            line_.keep(*nodes_);
        }
    }

    GoneTriangles run() {
        GoneTriangles gone = collapse_stars(
            queue_, collapse_, waiting(), lines_.silent(),
            [this](const EdgeQueue::Edge& edge) { return due(edge); }, [this] { return take(); });
        write_back();
        return gone;
    }

  private:
    /// The first of a vertex's copies waits if one of the copies waits.
    [[nodiscard]] std::vector<bool> waiting() const {
        std::vector<bool> waits = waiting_vertices(patch_.triangles, patch_.tried, locked_);
        for (std::uint32_t v = 0; v < waits.size(); ++v) {
            if (waits[v] && lines_.first(v) != v) {
                waits[lines_.first(v)] = true;
                waits[v] = false;
            }
        }
        return waits;
    }

    float due(const EdgeQueue::Edge& edge) {
        is_line_ = lines_.is_line(edge.from);
        if (is_line_) {
            const double largest = line_.look(edge.from, edge.to, limit_, kMaxMappedFold);
            // The next edge is searched around the first copy.
            collapse_.see(edge.from);
            return largest == LineCollapse::kRefused ? kNever : StarMapping::due_at(largest);
        }
        const float at = mapping_.due(collapse_, edge, limit_);
        return at < kNever && nodes_ &&
                       nodes_->any(collapse_.star(), point_at(patch_.positions[edge.from]), {})
                   ? kNever
                   : at;
    }

    std::uint32_t take() {
        if (is_line_) {
            return line_.take(queue_);
        }
        const std::uint32_t fewer = collapse_.fewer();
        mapping_.take(collapse_);
        collapse_.take();
        return fewer;
    }

    void write_back() {
        std::size_t left = 0;
        for (std::uint32_t t = 0; t < patch_.triangles.size(); ++t) {
            if (!mesh_.is_gone(t)) {
                const PatchTriangle c = mesh_.corners(t);
                patch_.triangles[left] = from_smallest(c);
                patch_.displacements[left] = patch_.displacements[t];
                patch_.tried[left] = is_free(c, locked_);
                ++left;
            }
        }
        patch_.triangles.resize(left);
        patch_.displacements.resize(left);
        patch_.tried.resize(left);
    }

    MappedPatch& patch_;
    double limit_;
    std::vector<bool> locked_;
    CornerMesh mesh_;
    SheetLines lines_;
    EdgeQueue queue_;
    StarCollapse collapse_;
    StarMapping mapping_;
    LineCollapse line_;
    std::optional<NodesPassed> nodes_;
    bool is_line_ = false;  ///< for the examined edge
};

}  // namespace

GoneTriangles map_patch(MappedPatch& patch, const CollapseLimits& limits) {
    return patch.triangles.empty() ? GoneTriangles{} : PatchMapper(patch, limits).run();
}

namespace {

/// Triangles per block.
constexpr std::uint32_t kMaxInBlock = 1U << 14U;
constexpr int kPasses = 3;

/// Builds the patch of a block, triangle by triangle.
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
    /// Completes the patch; call once. `next_copies`: of the mesh's vertices, or empty.
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
    /// Builds rings of the copies that are in the patch; they are shared if some are missing.
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
    return std::uint64_t{kMaxInBlock} * 2 * kMapBytesPerTriangle;
}

struct MeshMapper::Run {
    explicit Run(const ScratchFolder& folder) : full(folder), mesh(folder) {}

    CornerView triangles;  ///< the full surface; otherwise empty
    Consumed consumed;     ///< for these triangles
    BlockRuns full;        ///< runs of these triangles
    BlockItems<PackedTriangle> mesh;
    std::uint32_t blocks = 0;  ///< 0: nothing was sorted so far
    int third = 0;             ///< shift of the blocks into which they are sorted
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
    /// Declares that a block will not be read any more.
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

/// Sorts into its own blocks.
void MeshMapper::sort(Run& run) const {
    BlockGrid grid(lattice_, mesh_, run.third, folder_);
    run.each([&](const ElementCorners& t) { grid.count(t); });
    progress_.check();
    grid.divide(kMaxInBlock);
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

/// `afresh`: earlier results of `tried` were for another limit and are ignored. `is_last`: `from`
/// will not be read any more.
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
        // The first input may be used elsewhere.
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
            // Repeat, up to the estimate that leaves just few enough.
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
