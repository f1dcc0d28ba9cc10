#include "query/simplify/by_value/simplify_mesh_by_value.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "query/simplify/block_patch.h"
#include "query/simplify/block_triangles.h"
#include "query/simplify/by_value/simplify_patch_by_value.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kMostInBlock = 1U << 15U;  ///< triangles of the mesh as it was
constexpr int kPasses = 3;
constexpr std::uint32_t kTried = 1;  ///< mark: Patch::tried

/// What one thread looks at.
struct Worker {
    Worker(const ValueLimit& limit, const WorldLattice& lattice)
        : numbers(limit.numbers()),
          tree(*numbers, Lattice(lattice.nodes), limit.iso),
          cover(tree, lattice, limit.error) {}
    std::unique_ptr<GridNumbers> numbers;
    ValueTree tree;
    ValueCover cover;
};

BlockPatch patch_of(const ScratchMesh& mesh, const Valences& valences,
                    std::span<const Sorted> triangles, const PatchBox& box) {
    BlockPatch b;
    PatchNumbering numbering(mesh, b);
    for (const Sorted& t : triangles) {
        b.patch.triangles.push_back(numbering.local(t.corners));
        b.patch.tried.push_back((t.mark & kTried) != 0);
    }
    b.patch.stay.assign(triangles.size(), Stay::no);
    b.patch.box = box;
    b.patch.shared = shared_vertices(valences, b.vertex, b.patch.triangles);
    return b;
}

/// What a block hands on to the next pass.
struct Outcome {
    std::vector<Sorted> mesh;
    double largest = 0;
};

}  // namespace

std::uint64_t simplify_by_value_heap() {
    return std::uint64_t{kMostInBlock} * kValuePatchBytesPerTriangle + ValueTree::kBytes;
}

SimplifiedByValue::SimplifiedByValue(const ScratchMesh& mesh, const CornerView& triangles,
                                     const WorldLattice& lattice, const PatchBox& box,
                                     const ValueLimit& limit, const ScratchFolder& folder,
                                     Progress& progress)
    : corners_(folder) {
    const auto grid_of = [&](int third) {
        return std::make_unique<BlockGrid>(lattice, mesh, triangles, third, kMostInBlock, folder,
                                           progress);
    };
    const int threads = tbb::this_task_arena::max_concurrency();
    // One for each place in the arena, which has one thread at a time.
    std::vector<std::unique_ptr<Worker>> workers(static_cast<std::size_t>(threads));
    auto grid = grid_of(0);
    auto from = std::make_unique<BlockTriangles>(folder);
    for (const ElementCorners corners : triangles) {
        from->append({corners, grid->block_of(corners), 0});
    }
    from->sort(grid->blocks());
    for (int pass = 0; pass < kPasses; ++pass) {
        const bool is_last = pass + 1 == kPasses;
        auto after = is_last ? nullptr : grid_of(pass + 1);
        auto next = std::make_unique<BlockTriangles>(folder);
        const Valences valences(mesh.layout().vertices, from->all(), folder);
        progress.begin("simplify", from->count(), "triangles");
        in_order(
            grid->blocks(), threads + 1,
            [&](std::int64_t i) {
                progress.check();
                const auto block = from->of(static_cast<std::uint32_t>(i));
                Outcome outcome;
                if (block.empty()) {
                    return outcome;
                }
                std::unique_ptr<Worker>& worker =
                    workers[static_cast<std::size_t>(tbb::this_task_arena::current_thread_index())];
                if (!worker) {
                    worker = std::make_unique<Worker>(limit, lattice);
                }
                const BlockPatch b = patch_of(mesh, valences, block, box);
                const ValuePatch simplified =
                    simplify_patch_by_value(b.patch, limit.has_caps, worker->cover);
                worker->numbers->rest();
                outcome.largest = simplified.largest;
                for (std::size_t k = 0; k < simplified.triangles.size(); ++k) {
                    const PatchTriangle& t = simplified.triangles[k];
                    const ElementCorners corners{b.vertex[t[0]], b.vertex[t[1]], b.vertex[t[2]]};
                    outcome.mesh.push_back({corners, is_last ? 0 : after->block_of(corners),
                                            simplified.tried[k] ? kTried : 0});
                }
                progress.advance(block.size());
                return outcome;
            },
            [&](std::int64_t /*i*/, const Outcome& outcome) {
                next->append(outcome.mesh);
                largest_ = std::max(largest_, outcome.largest);
            });
        next->sort(is_last ? 1 : after->blocks());
        from = std::move(next);
        grid = std::move(after);
    }
    count_ = from->count();
    corners_.map(count_ * sizeof(ElementCorners));
    std::transform(from->all().begin(), from->all().end(), corners_.as<ElementCorners>().begin(),
                   [](const Sorted& t) { return t.corners; });
}

}  // namespace isonest::detail
