#include "query/simplify/simplify_mesh.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "query/simplify/block_patch.h"
#include "query/simplify/block_triangles.h"
#include "query/simplify/simplify_patch.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

/// Fine triangles in a block.
constexpr std::uint32_t kMostInBlock = 1U << 15U;
constexpr int kShifts = 3;  ///< of the blocks
constexpr int kPasses = 3;

// Marks of triangles of the mesh.
constexpr std::uint32_t kForever = 1;  ///< it has to stay
constexpr std::uint32_t kTried = 2;    ///< Patch::tried

/// A fine triangle that is near to triangles of several blocks: none of these can see alone that it
/// stays so. So they stay as long as they lie in several blocks.
struct Split {
    static constexpr std::size_t kMost = 4;
    ElementCorners corners{};
    std::uint64_t count = 0;
    std::array<ElementCorners, kMost> servers{};
};

/// `afresh`: what was tried was so within another limit.
BlockPatch patch_of(const ScratchMesh& mesh, const Valences& valences,
                    std::span<const Sorted> triangles, std::span<const Sorted> fine,
                    std::span<const Sorted> held, bool afresh) {
    BlockPatch b;
    Patch& patch = b.patch;
    PatchNumbering numbering(mesh, b);
    const auto local = [&](const ElementCorners& corners) { return numbering.local(corners); };
    std::vector<ElementCorners> held_corners(held.size());
    std::transform(held.begin(), held.end(), held_corners.begin(),
                   [](const Sorted& t) { return from_smallest(t.corners); });
    std::sort(held_corners.begin(), held_corners.end());
    for (const Sorted& t : triangles) {
        patch.triangles.push_back(local(t.corners));
        const bool is_held =
            std::binary_search(held_corners.begin(), held_corners.end(), from_smallest(t.corners));
        patch.stay.push_back((t.mark & kForever) != 0 ? Stay::forever
                             : is_held                ? Stay::now
                                                      : Stay::no);
        patch.tried.push_back(!afresh && (t.mark & kTried) != 0);
    }
    for (const Sorted& t : fine) {
        patch.fine.push_back(local(t.corners));
        patch.attached.push_back(t.mark != 0);
    }
    find_shared(valences, b);
    return b;
}

/// What a block hands on to the next pass.
struct Outcome {
    std::vector<Sorted> mesh;
    std::vector<Sorted> fine;
    std::vector<Split> splits;
    double largest = 0;
};

/// `next`: the blocks of the next pass.
Outcome outcome_of(const BlockPatch& b, const SimplifiedPatch& simplified, const BlockGrid& next) {
    Outcome outcome;
    outcome.largest = simplified.largest;
    const auto global = [&](const PatchTriangle& t) {
        return ElementCorners{b.vertex[t[0]], b.vertex[t[1]], b.vertex[t[2]]};
    };
    for (const PatchTriangle& t : simplified.triangles) {
        const ElementCorners corners = global(t);
        outcome.mesh.push_back({corners, next.block_of(corners), 0});
    }
    for (std::size_t i = 0; i < b.patch.fine.size(); ++i) {
        const auto servers = simplified.servers_of(i);
        if (servers.empty()) {
            continue;
        }
        const std::uint32_t block = outcome.mesh[servers.front()].block;
        const ElementCorners corners = global(b.patch.fine[i]);
        if (std::all_of(servers.begin(), servers.end(),
                        [&](std::uint32_t s) { return outcome.mesh[s].block == block; })) {
            outcome.fine.push_back({corners, block, 1});
        } else if (servers.size() <= Split::kMost) {
            Split split{corners, servers.size(), {}};
            std::transform(servers.begin(), servers.end(), split.servers.begin(),
                           [&](std::uint32_t s) { return outcome.mesh[s].corners; });
            outcome.splits.push_back(split);
        } else {
            // Nobody will look at it again: those that it is near to stay for good.
            for (const std::uint32_t s : servers) {
                outcome.mesh[s].mark |= kForever;
            }
        }
    }
    // Those that had to stay for good still do.
    for (std::size_t i = 0; i < simplified.kept.size(); ++i) {
        outcome.mesh[i].mark |=
            (simplified.kept[i] ? kForever : 0U) | (simplified.tried[i] ? kTried : 0U);
    }
    return outcome;
}

}  // namespace

std::uint64_t simplify_heap() {
    return std::uint64_t{kMostInBlock} * 2 * kSimplifyBytesPerTriangle;
}

struct MeshSimplifier::Run {
    explicit Run(const std::filesystem::path& folder)
        : mesh(folder), fine(folder), held(folder), splits(folder) {}
    /// `grid`: of the blocks of the next pass.
    void add(const Split& split, const BlockGrid& grid);
    BlockTriangles mesh;
    /// The full surface; marked: near to triangles of its block alone. Others are there to be near
    /// to.
    BlockTriangles fine;
    BlockTriangles held;  ///< triangles of the mesh that stay in the next pass
    GrowingFile<Split> splits;
    int third = 0;  ///< the shift of the blocks that they are sorted into next
    double bound = 0;
};

void MeshSimplifier::Run::add(const Split& split, const BlockGrid& grid) {
    const auto servers = std::span(split.servers).first(split.count);
    const std::uint32_t block = grid.block_of(servers.front());
    if (std::all_of(servers.begin(), servers.end(),
                    [&](const ElementCorners& s) { return grid.block_of(s) == block; })) {
        fine.append({split.corners, block, 1});
        return;
    }
    splits.append(split);
    for (const ElementCorners& server : servers) {
        const std::uint32_t of = grid.block_of(server);
        held.append({server, of, 0});
        fine.append({split.corners, of, 0});
    }
}

MeshSimplifier::MeshSimplifier(const ScratchMesh& mesh, std::span<const ElementCorners> triangles,
                               const WorldLattice& lattice, const PatchBox& box,
                               std::filesystem::path folder, Progress& progress)
    : mesh_(mesh), box_(box), folder_(std::move(folder)), progress_(progress) {
    for (int third = 0; third < kShifts; ++third) {
        grids_.push_back(std::make_unique<BlockGrid>(lattice, mesh, triangles, third, kMostInBlock,
                                                     folder_, progress));
    }
    full_ = std::make_shared<Run>(folder_);
    for (const ElementCorners& corners : triangles) {
        const std::uint32_t block = grids_.front()->block_of(corners);
        full_->mesh.append({corners, block, 0});
        full_->fine.append({corners, block, 1});
    }
    finish(*full_);
}

MeshSimplifier::~MeshSimplifier() = default;

void MeshSimplifier::finish(Run& run) {
    const std::uint32_t blocks = grids_[static_cast<std::size_t>(run.third)]->blocks();
    run.mesh.sort(blocks);
    run.fine.sort(blocks);
    run.held.sort(blocks);
    run.splits.seal();
    // One run is made from another, and both are written twice while they are sorted.
    scratch_bytes_ = std::max(scratch_bytes_, 2 * (run.mesh.bytes() + run.fine.bytes() +
                                                   run.held.bytes() + run.splits.bytes()));
}

std::shared_ptr<MeshSimplifier::Run> MeshSimplifier::pass(const Run& from, double limit,
                                                          bool afresh) {
    const BlockGrid& grid = *grids_[static_cast<std::size_t>(from.third)];
    auto next = std::make_shared<Run>(folder_);
    next->third = (from.third + 1) % kShifts;
    next->bound = from.bound;
    const BlockGrid& after = *grids_[static_cast<std::size_t>(next->third)];
    const Valences valences(mesh_.layout().vertices, from.mesh.all(), folder_);
    progress_.begin("simplify", from.mesh.count(), "triangles");
    in_order(
        grid.blocks(), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            const auto block = static_cast<std::uint32_t>(i);
            const auto triangles = from.mesh.of(block);
            if (triangles.empty()) {
                return Outcome{};
            }
            BlockPatch b = patch_of(mesh_, valences, triangles, from.fine.of(block),
                                    from.held.of(block), afresh);
            b.patch.box = box_;
            const Outcome outcome = outcome_of(b, simplify_patch(b.patch, limit), after);
            progress_.advance(triangles.size());
            return outcome;
        },
        [&](std::int64_t /*i*/, const Outcome& outcome) {
            next->mesh.append(outcome.mesh);
            next->fine.append(outcome.fine);
            for (const Split& split : outcome.splits) {
                next->add(split, after);
            }
            next->bound = std::max(next->bound, outcome.largest);
        });
    for (const Split& split : from.splits.all()) {
        next->add(split, after);
    }
    finish(*next);
    return next;
}

Simplified MeshSimplifier::full() const {
    return {full_, full_->mesh.count(), 0};
}

Simplified MeshSimplifier::within(const Simplified& from, double limit) {
    std::shared_ptr<const Run> run = from.run;
    for (int i = 0; i < kPasses; ++i) {
        run = pass(*run, limit, i == 0);
    }
    return {run, run->mesh.count(), run->bound};
}

ScratchFile MeshSimplifier::corners(const Simplified& of) const {
    ScratchFile file(folder_);
    const auto all = of.run->mesh.all();
    file.map(all.size() * sizeof(ElementCorners));
    std::transform(all.begin(), all.end(), file.as<ElementCorners>().begin(),
                   [](const Sorted& t) { return t.corners; });
    return file;
}

}  // namespace isonest::detail
