#include "query/simplify/mapping/map_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "query/simplify/block_patch.h"
#include "query/simplify/block_triangles.h"
#include "query/simplify/mapping/edge_queue.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

/// Triangles in a block.
constexpr std::uint32_t kMostInBlock = 1U << 14U;
constexpr int kShifts = 3;  ///< of the blocks
constexpr int kPasses = 3;
/// Edges of which the quadrics estimate that they are further off, in limits, are not tried.
constexpr double kFurthest = 1.5;

MappingLimits limits_of(double distance) {
    const double estimate = kFurthest * distance;
    return {distance, static_cast<float>(estimate * estimate)};
}

/// A triangle between two passes.
struct MappedTriangle {
    ElementCorners corners{};
    std::uint32_t block = 0;
    std::uint32_t tried = 0;  ///< MappedPatch::tried
    Displacement displacement;
};

struct MappedBlock {
    MappedPatch patch;
    std::vector<std::uint64_t> vertex;
    MappingResult result;
};

/// `afresh`: what was tried was so within another limit.
MappedBlock block_of(const ScratchMesh& mesh, const Valences& valences,
                     std::span<const MappedTriangle> triangles, bool afresh) {
    MappedBlock b;
    BlockPatch numbered;
    PatchNumbering numbering(mesh, numbered);
    for (const MappedTriangle& t : triangles) {
        numbered.patch.triangles.push_back(numbering.local(t.corners));
        b.patch.displacements.push_back(t.displacement);
        b.patch.tried.push_back(!afresh && t.tried != 0);
    }
    find_shared(valences, numbered);
    b.patch.positions = std::move(numbered.patch.positions);
    b.patch.shared = std::move(numbered.patch.shared);
    b.patch.triangles = std::move(numbered.patch.triangles);
    b.vertex = std::move(numbered.vertex);
    return b;
}

}  // namespace

std::uint64_t map_heap() {
    return std::uint64_t{kMostInBlock} * 2 * kMapBytesPerTriangle;
}

struct MeshMapper::Run {
    explicit Run(const std::filesystem::path& folder) : mesh(folder) {}
    SortedByBlocks<MappedTriangle> mesh;
    std::uint32_t blocks = 0;
    int third = 0;  ///< the shift of the blocks that they are sorted into
    double bound = 0;
};

/// How many triangles collapses take out, by the largest estimate until then.
struct MeshMapper::Collapses {
    std::vector<std::uint64_t> triangles;
};

MeshMapper::MeshMapper(const ScratchMesh& mesh, std::span<const ElementCorners> triangles,
                       const WorldLattice& lattice, const PatchBox& box,
                       std::filesystem::path folder, Progress& progress)
    : mesh_(mesh),
      lattice_(lattice),
      box_(box),
      folder_(std::move(folder)),
      progress_(progress),
      full_(std::make_shared<Run>(folder_)) {
    for (const ElementCorners& corners : triangles) {
        full_->mesh.append({corners, 0, 0, {}});
    }
    sort(*full_);
}

MeshMapper::~MeshMapper() = default;

/// Into blocks of their own.
void MeshMapper::sort(Run& run) {
    BlockGrid grid(lattice_, mesh_.positions(), run.third, folder_);
    const auto triangles = run.mesh.unsorted();
    for (const MappedTriangle& t : triangles) {
        grid.count(t.corners);
    }
    progress_.check();
    grid.divide(kMostInBlock);
    for (MappedTriangle& t : triangles) {
        t.block = grid.block_of(t.corners);
    }
    progress_.check();
    run.blocks = grid.blocks();
    run.mesh.sort(run.blocks);
    // One run is made from another, and each is written twice while it is sorted.
    scratch_bytes_ = std::max(scratch_bytes_, 2 * run.mesh.bytes());
}

std::shared_ptr<MeshMapper::Run> MeshMapper::pass(const Run& from, const MappingLimits& limits,
                                                  bool afresh, Collapses* collapses) {
    auto next = std::make_shared<Run>(folder_);
    next->third = (from.third + 1) % kShifts;
    const Valences valences(mesh_.layout().vertices, from.mesh.all(), folder_);
    progress_.begin("simplify", from.mesh.count(), "triangles");
    in_order(
        from.blocks, tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            const auto triangles = from.mesh.of(static_cast<std::uint32_t>(i));
            if (triangles.empty()) {
                return MappedBlock{};
            }
            MappedBlock block = block_of(mesh_, valences, triangles, afresh);
            block.patch.box = box_;
            block.result = map_patch(block.patch, limits);
            progress_.advance(triangles.size());
            return block;
        },
        [&](std::int64_t /*i*/, const MappedBlock& block) {
            for (std::size_t i = 0; i < block.patch.triangles.size(); ++i) {
                const PatchTriangle& t = block.patch.triangles[i];
                const Displacement& d = block.patch.displacements[i];
                next->mesh.append({{block.vertex[t[0]], block.vertex[t[1]], block.vertex[t[2]]},
                                   0,
                                   block.patch.tried[i] ? 1U : 0U,
                                   d});
                next->bound = std::max(next->bound, d.bound());
            }
            if (collapses != nullptr) {
                auto& sum = collapses->triangles;
                const auto& of = block.result.gone_at;
                sum.resize(std::max(sum.size(), of.size()));
                for (std::size_t i = 0; i < of.size(); ++i) {
                    sum[i] += of[i];
                }
            }
        });
    sort(*next);
    return next;
}

Mapped MeshMapper::full() const {
    return {full_, full_->mesh.count(), 0};
}

Mapped MeshMapper::within(const Mapped& from, double limit) {
    std::shared_ptr<const Run> run = from.run;
    for (int i = 0; i < kPasses; ++i) {
        run = pass(*run, limits_of(limit), i == 0);
    }
    return {run, run->mesh.count(), run->bound};
}

Mapped MeshMapper::down_to(std::uint64_t triangles, double first, double most) {
    Mapped mapped = full();
    constexpr double kFactor = 2;
    for (double limit = std::min(first, most); mapped.triangles > triangles;
         limit = std::min(limit * kFactor, most)) {
        Collapses collapses;
        const MappingLimits limits = limits_of(limit);
        std::shared_ptr<const Run> run = pass(*mapped.run, limits, true, &collapses);
        const bool is_enough = run->mesh.count() <= triangles;
        if (is_enough) {
            // Again, up to the estimate at which there are just few enough.
            std::uint64_t left = mapped.triangles;
            std::size_t bin = 0;
            while (left > triangles) {
                left -= collapses.triangles[bin++];
            }
            run = pass(*mapped.run,
                       {limit, std::min(limits.square_estimate, end_of_bin(bin - 1))}, true);
        }
        const bool is_last = limit >= most && run->mesh.count() >= mapped.triangles;
        mapped = {run, run->mesh.count(), run->bound};
        if (is_enough || is_last) {
            break;
        }
    }
    return mapped;
}

ScratchFile MeshMapper::corners(const Mapped& of) const {
    ScratchFile file(folder_);
    const auto all = of.run->mesh.all();
    file.map(all.size() * sizeof(ElementCorners));
    std::transform(all.begin(), all.end(), file.as<ElementCorners>().begin(),
                   [](const MappedTriangle& t) { return t.corners; });
    return file;
}

}  // namespace isonest::detail
