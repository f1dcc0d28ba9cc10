#include "query/simplify/mapping/map_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "query/simplify/block_patch.h"
#include "query/simplify/block_triangles.h"
#include "store/base/in_order.h"

namespace isonest::detail {

/// A triangle between two passes.
struct MappedTriangle {
    ElementCorners corners{};
    std::uint32_t block = 0;
    std::uint32_t tried = 0;  ///< MappedPatch::tried
    Displacement displacement;
};

/// A triangle of the full surface, which stays where it is.
struct FullTriangle {
    std::uint64_t place = 0;
    std::uint32_t block = 0;
};

namespace {

/// Triangles in a block.
constexpr std::uint32_t kMostInBlock = 1U << 14U;
constexpr int kPasses = 3;
/// Edges of which the quadrics estimate that they are further off, in limits, are not tried.
constexpr double kFurthest = 1.5;

/// Gives the patch all but what is known of its triangles. `is_shared(vertex, triangles here)`.
template <class Corners, class IsShared>
void number(const ScratchMesh& mesh, const PatchBox& box, std::size_t count,
            const Corners& corners_of, const IsShared& is_shared, MappedBlock& block) {
    BlockPatch numbered;
    PatchNumbering numbering(mesh, numbered);
    MappedPatch& patch = block.patch;
    patch.triangles.reserve(count);
    for (std::size_t i = 0; i < count; ++i) {
        patch.triangles.push_back(numbering.local(corners_of(i)));
    }
    patch.box = box;
    patch.positions = std::move(numbered.patch.positions);
    block.vertex = std::move(numbered.vertex);
    std::vector<std::uint32_t> here(block.vertex.size());
    for (const PatchTriangle& t : patch.triangles) {
        for (const std::uint32_t v : t) {
            ++here[v];
        }
    }
    patch.shared.reserve(here.size());
    for (std::size_t v = 0; v < here.size(); ++v) {
        patch.shared.push_back(is_shared(block.vertex[v], here[v]));
    }
}

}  // namespace

std::uint64_t map_heap() {
    return std::uint64_t{kMostInBlock} * 2 * kMapBytesPerTriangle;
}

std::uint64_t mapped_at_a_time() {
    return kMostInBlock;
}

struct MeshMapper::Run {
    explicit Run(const std::filesystem::path& folder) : full(folder), mesh(folder) {}

    std::span<const ElementCorners> triangles;  ///< the full surface; else none
    SortedByBlocks<FullTriangle> full;
    SortedByBlocks<MappedTriangle> mesh;
    std::uint32_t blocks = 0;
    int third = 0;  ///< the shift of the blocks that they are sorted into
    double bound = 0;

    [[nodiscard]] std::uint64_t count() const {
        return triangles.empty() ? mesh.count() : triangles.size();
    }
    template <class Visit>
    void each(const Visit& visit) const {
        for (const ElementCorners& t : triangles) {
            visit(t);
        }
        for (const MappedTriangle& t : mesh.all()) {
            visit(t.corners);
        }
    }
};

MeshMapper::MeshMapper(const ScratchMesh& mesh, const WorldLattice& lattice, const PatchBox& box,
                       std::filesystem::path folder, Progress& progress)
    : mesh_(mesh), lattice_(lattice), box_(box), folder_(std::move(folder)), progress_(progress) {}

MeshMapper::~MeshMapper() = default;

Mapped MeshMapper::full(std::span<const ElementCorners> triangles) {
    auto run = std::make_shared<Run>(folder_);
    run->triangles = triangles;
    for (std::uint64_t i = 0; i < triangles.size(); ++i) {
        run->full.append({i, 0});
    }
    sort(*run);
    return {run, run->count(), 0, 0};
}

MappedBlock MeshMapper::map(std::span<const ElementCorners> triangles,
                            const std::function<bool(std::uint64_t)>& is_shared,
                            double limit) const {
    MappedBlock block;
    number(
        mesh_, box_, triangles.size(), [&](std::size_t i) { return triangles[i]; },
        [&](std::uint64_t v, std::uint32_t /*here*/) { return is_shared(v); }, block);
    block.patch.displacements.resize(triangles.size());
    block.patch.tried.resize(triangles.size());
    block.gone_at = map_patch(block.patch, limits_of(limit, kFurthest));
    return block;
}

void MeshMapper::add(const MappedBlock& block) {
    if (!added_) {
        added_ = std::make_shared<Run>(folder_);
    }
    append(*added_, block);
}

Mapped MeshMapper::whole(double limit) {
    const std::shared_ptr<Run> run = added_ ? added_ : std::make_shared<Run>(folder_);
    added_.reset();
    run->third = 1;  // the parts were cut along the first grid's borders, or nearly so
    sort(*run);
    return {run, run->count(), run->bound, limit};
}

void MeshMapper::append(Run& run, const MappedBlock& block) {
    for (std::size_t i = 0; i < block.patch.triangles.size(); ++i) {
        const PatchTriangle& t = block.patch.triangles[i];
        const Displacement& d = block.patch.displacements[i];
        run.mesh.append({{block.vertex[t[0]], block.vertex[t[1]], block.vertex[t[2]]},
                         0,
                         block.patch.tried[i] ? 1U : 0U,
                         d});
        run.bound = std::max(run.bound, d.bound());
    }
}

/// Into blocks of their own.
void MeshMapper::sort(Run& run) {
    BlockGrid grid(lattice_, mesh_, run.third, folder_);
    const auto full = run.full.unsorted();
    const auto mesh = run.mesh.unsorted();
    for (const ElementCorners& t : run.triangles) {
        grid.count(t);
    }
    for (const MappedTriangle& t : mesh) {
        grid.count(t.corners);
    }
    progress_.check();
    grid.divide(kMostInBlock);
    for (FullTriangle& t : full) {
        t.block = grid.block_of(run.triangles[t.place]);
    }
    for (MappedTriangle& t : mesh) {
        t.block = grid.block_of(t.corners);
    }
    progress_.check();
    run.blocks = grid.blocks();
    run.full.sort(run.blocks);
    run.mesh.sort(run.blocks);
    // One run is made from another.
    scratch_bytes_ = std::max(scratch_bytes_, 2 * (run.full.bytes() + run.mesh.bytes()));
}

MappedBlock MeshMapper::load(const Run& run, const Valences& valences, std::uint32_t block,
                             bool afresh) const {
    MappedBlock b;
    const auto full = run.full.of(block);
    const auto mesh = run.mesh.of(block);
    const auto is_shared = [&](std::uint64_t v, std::uint32_t here) {
        return here != valences.of(v);
    };
    number(
        mesh_, box_, full.size() + mesh.size(),
        [&](std::size_t i) {
            return i < full.size() ? run.triangles[full[i].place] : mesh[i - full.size()].corners;
        },
        is_shared, b);
    b.patch.displacements.resize(full.size());
    b.patch.tried.resize(full.size());
    for (const MappedTriangle& t : mesh) {
        b.patch.displacements.push_back(t.displacement);
        b.patch.tried.push_back(!afresh && t.tried != 0);
    }
    return b;
}

/// `afresh`: what was tried was so within another limit.
std::shared_ptr<MeshMapper::Run> MeshMapper::pass(const Run& from, const CollapseLimits& limits,
                                                  bool afresh, GoneTriangles* gone) {
    auto next = std::make_shared<Run>(folder_);
    next->third = (from.third + 1) % kBlockShifts;
    Valences valences(mesh_.layout().vertices, folder_);
    from.each([&](const ElementCorners& t) { valences.count(t); });
    progress_.begin("simplify", from.count(), "triangles");
    in_order(
        from.blocks, tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            MappedBlock block = load(from, valences, static_cast<std::uint32_t>(i), afresh);
            const std::size_t count = block.patch.triangles.size();
            block.gone_at = map_patch(block.patch, limits);
            progress_.advance(count);
            return block;
        },
        [&](std::int64_t /*i*/, const MappedBlock& block) {
            append(*next, block);
            if (gone != nullptr) {
                add_gone(*gone, block.gone_at);
            }
        });
    sort(*next);
    return next;
}

Mapped MeshMapper::within(const Mapped& from, double limit) {
    std::shared_ptr<const Run> run = from.run;
    for (int i = 0; i < kPasses; ++i) {
        run = pass(*run, limits_of(limit, kFurthest), i == 0 && from.limit != limit);
    }
    return {run, run->count(), run->bound, limit};
}

Mapped MeshMapper::down_to(const Mapped& from, std::uint64_t triangles, double first, double most) {
    Mapped mapped = from;
    constexpr double kFactor = 2;
    for (double limit = std::min(first, most); mapped.triangles > triangles;
         limit = std::min(limit * kFactor, most)) {
        GoneTriangles gone;
        const CollapseLimits limits = limits_of(limit, kFurthest);
        std::shared_ptr<const Run> run = pass(*mapped.run, limits, true, &gone);
        const bool is_enough = run->count() <= triangles;
        if (is_enough) {
            // Again, up to the estimate at which there are just few enough.
            run = pass(*mapped.run, up_to(limits, gone, mapped.triangles, triangles), true);
        }
        const bool is_last = limit >= most && run->count() >= mapped.triangles;
        mapped = {run, run->count(), run->bound, limit};
        if (is_enough || is_last) {
            break;
        }
    }
    return mapped;
}

ScratchFile MeshMapper::corners(const Mapped& of) const {
    ScratchFile file(folder_);
    file.map(of.triangles * sizeof(ElementCorners));
    auto to = file.as<ElementCorners>().begin();
    of.run->each([&](const ElementCorners& t) { *to++ = t; });
    return file;
}

}  // namespace isonest::detail
