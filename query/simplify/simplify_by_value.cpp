#include "query/simplify/simplify_by_value.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "query/simplify/block_files.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/collapse/star_mapping.h"
#include "query/simplify/proof/trilinear_cover.h"
#include "query/simplify/proof/value_cover.h"
#include "store/base/in_order.h"

namespace isonest::detail {
namespace {

class Simplifier {
  public:
    Simplifier(const Patch& patch, bool has_caps, double error, ValueProof& proof, Effort effort)
        : patch_(patch),
          has_caps_(has_caps),
          proof_(proof),
          is_fast_(effort == Effort::fast),
          locked_(locked_vertices(patch)),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          queue_(patch.positions, mesh_, std::numeric_limits<float>::max()),
          collapse_(patch.positions, patch.box, patch.shared, locked_, mesh_) {
        if (is_fast_) {
            queue_.limit(furthest(error));
        }
    }

    ValuePatch run() {
        double largest = 0;
        collapse_stars(
            queue_, collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [this](const EdgeQueue::Edge& edge) { return fits(edge.from, edge.to) ? 0 : kNever; },
            [&] {
                largest = std::max(largest, met_);
                const std::uint32_t fewer = collapse_.fewer();
                collapse_.take();
                return fewer;
            });
        ValuePatch result;
        result.largest = largest;
        for (std::uint32_t i = 0; i < patch_.triangles.size(); ++i) {
            if (!mesh_.is_gone(i)) {
                const PatchTriangle t = mesh_.corners(i);
                result.triangles.push_back(from_smallest(t));
                result.tried.push_back(is_free(t, locked_));
                result.place.push_back(result.triangles.back() == from_smallest(patch_.triangles[i])
                                           ? i
                                           : kNotInPatch);
            }
        }
        return result;
    }

  private:
    /// For each vertex, the square of the distance by which the surface may be expected to move: in
    /// the direction of steepest ascent, several times the distance at which the error is reached.
    std::vector<float> furthest(double error) {
        constexpr double kReach = 2;
        std::vector<float> most(patch_.positions.size());
        for (std::uint32_t v = 0; v < most.size(); ++v) {
            const double slope = locked_[v] ? 0 : proof_.slope(patch_.point(v));
            const double reach = kReach * error / slope;
            most[v] = slope > 0 && reach < kNever ? static_cast<float>(reach * reach) : kNever;
        }
        return most;
    }
    [[nodiscard]] bool is_cap(const PatchTriangle& t) const {
        return has_caps_ && (collapse_.faces_of(t[0]) & collapse_.faces_of(t[1]) &
                             collapse_.faces_of(t[2])) != 0;
    }
    bool covers(const PatchTriangle& t) {
        if (!proof_.covers(patch_.at(t))) {
            return false;
        }
        met_ = std::max(met_, proof_.largest());
        return true;
    }
    /// Whether the shape of the new triangles alone is acceptable.
    bool has_shape() {
        return is_fast_ ? collapse_.has_no_new_needle() &&
                              collapse_.has_no_new_fold(kMaxMappedFold) && collapse_.turns_little()
                        : may_be_measured(collapse_);
    }
    /// Whether an evaluation at the middles of the new triangles and edges shows that they are too
    /// far away.
    bool misses() {
        const Star& star = collapse_.star();
        const Double3 to = patch_.point(collapse_.vertex(0));
        for (std::size_t j = 1; j + 1 < star.corners; ++j) {
            if (is_cap(mesh_.corners(collapse_.triangle(j)))) {
                continue;
            }
            const Double3 p = patch_.point(collapse_.vertex(j));
            const Double3 q = patch_.point(collapse_.vertex(j + 1));
            const Double3 edge{(to[0] + p[0]) / 2, (to[1] + p[1]) / 2, (to[2] + p[2]) / 2};
            const Double3 centre{(to[0] + p[0] + q[0]) / 3, (to[1] + p[1] + q[1]) / 3,
                                 (to[2] + p[2] + q[2]) / 3};
            if ((j > 1 && proof_.misses(edge)) || proof_.misses(centre)) {
                return true;
            }
        }
        return false;
    }
    bool fits(std::uint32_t from, std::uint32_t to) {
        if (!collapse_.look(from, to) || !has_shape() || misses()) {
            return false;
        }
        met_ = 0;
        const Star& star = collapse_.star();
        for (std::size_t j = 1; j + 1 < star.corners; ++j) {
            if (is_cap(mesh_.corners(collapse_.triangle(j)))) {
                continue;
            }
            const PatchTriangle after = collapse_.after(j);
            if (is_cap(after) || !covers(after)) {
                return false;
            }
        }
        return !has_caps_ || collapse_.faces_of(from) == 0 || rims_fit(from, to);
    }
    /// Whether the lines between surface and caps that start at `from` also stay near.
    bool rims_fit(std::uint32_t from, std::uint32_t to) {
        const Star& star = collapse_.star();
        for (std::size_t i = 1; i < star.corners; ++i) {
            // Between old triangles i - 1 and i; there is no line to the corner that `from`
            // becomes.
            if (i - 1 != star.missing && i != star.missing &&
                is_cap(mesh_.corners(collapse_.triangle(i - 1))) !=
                    is_cap(mesh_.corners(collapse_.triangle(i))) &&
                !covers({from, collapse_.vertex(i), to})) {
                return false;
            }
        }
        return true;
    }

    const Patch& patch_;
    bool has_caps_;
    ValueProof& proof_;
    bool is_fast_;
    std::vector<bool> locked_;
    CornerMesh mesh_;
    EdgeQueue queue_;
    StarCollapse collapse_;
    double met_ = 0;
};

}  // namespace

ValuePatch simplify_patch_by_value(const Patch& patch, bool has_caps, double error,
                                   ValueProof& proof, Effort effort) {
    return Simplifier(patch, has_caps, error, proof, effort).run();
}

namespace {

constexpr std::uint32_t kMaxInBlock = 1U << 15U;  ///< triangles of the original mesh
constexpr int kPasses = 3;
constexpr int kFastPasses = 2;
/// Number of divisions of triangles: each brings the bounds of the function about four times as
/// close to it.
constexpr int kCuts = 3;
constexpr int kFastCuts = 1;
constexpr std::uint32_t kTried = 1;  ///< mark: Patch::tried
constexpr std::uint32_t kMade = 2;   ///< mark: not a triangle of the original mesh

/// State of one thread.
struct Worker {
    Worker(const ValueLimit& limit, const WorldLattice& lattice) : numbers(limit.numbers()) {
        if (limit.cells == Cells::hexahedra) {
            proof =
                std::make_unique<TrilinearCover>(*numbers, lattice, limit.iso, limit.error,
                                                 limit.effort == Effort::fast ? kFastCuts : kCuts);
        } else {
            tree = std::make_unique<ValueTree>(*numbers, Lattice(lattice.nodes), limit.iso);
            proof = std::make_unique<ValueCover>(*tree, lattice, limit.error);
        }
    }
    std::unique_ptr<GridNumbers> numbers;
    std::unique_ptr<ValueTree> tree;
    std::unique_ptr<ValueProof> proof;
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

/// What a block passes on to the next pass.
struct Outcome {
    std::vector<Sorted> mesh;
    double largest = 0;
    double largest_kept = 0;
};

/// Whether a triangle lies in a face of the patch's box.
bool is_in_face(const Patch& patch, const PatchTriangle& t) {
    return (patch.box.faces_of(patch.positions[t[0]]) & patch.box.faces_of(patch.positions[t[1]]) &
            patch.box.faces_of(patch.positions[t[2]])) != 0;
}

}  // namespace

std::uint64_t simplify_by_value_heap(Cells cells) {
    return std::uint64_t{kMaxInBlock} * kValuePatchBytesPerTriangle +
           (cells == Cells::hexahedra ? CellValues::kBytes : ValueTree::kBytes);
}

SimplifiedByValue::SimplifiedByValue(const ScratchMesh& mesh, const CornerView& triangles,
                                     const WorldLattice& lattice, const PatchBox& box,
                                     const ValueLimit& limit, const ScratchFolder& folder,
                                     Progress& progress)
    : corners_(folder) {
    const auto grid_of = [&](int third) {
        return std::make_unique<BlockGrid>(lattice, mesh, triangles, third, kMaxInBlock, folder,
                                           progress);
    };
    const int threads = tbb::this_task_arena::max_concurrency();
    // One for each slot of the arena, which is used by one thread at a time.
    std::vector<std::unique_ptr<Worker>> workers(static_cast<std::size_t>(threads));
    auto grid = grid_of(0);
    auto from = std::make_unique<BlockTriangles>(folder);
    for (const ElementCorners corners : triangles) {
        from->append({corners, grid->block_of(corners), 0});
    }
    from->sort(grid->blocks());
    const int passes = limit.effort == Effort::fast ? kFastPasses : kPasses;
    for (int pass = 0; pass < passes; ++pass) {
        const bool is_last = pass + 1 == passes;
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
                const ValuePatch simplified = simplify_patch_by_value(
                    b.patch, limit.has_caps, limit.error, *worker->proof, limit.effort);
                outcome.largest = simplified.largest;
                for (std::size_t k = 0; k < simplified.triangles.size(); ++k) {
                    const PatchTriangle& t = simplified.triangles[k];
                    const std::uint32_t place = simplified.place[k];
                    const bool is_kept = place != kNotInPatch && (block[place].mark & kMade) == 0;
                    const ElementCorners corners{b.vertex[t[0]], b.vertex[t[1]], b.vertex[t[2]]};
                    outcome.mesh.push_back(
                        {corners, is_last ? 0 : after->block_of(corners),
                         (simplified.tried[k] ? kTried : 0U) | (is_kept ? 0U : kMade)});
                    if (is_last && is_kept && limit.cells == Cells::hexahedra) {
                        if (!limit.has_caps || !is_in_face(b.patch, t)) {
                            outcome.largest_kept = std::max(outcome.largest_kept,
                                                            worker->proof->max_on(b.patch.at(t)));
                        }
                    }
                }
                worker->proof->rest();
                progress.advance(block.size());
                return outcome;
            },
            [&](std::int64_t /*i*/, const Outcome& outcome) {
                next->append(outcome.mesh);
                largest_ = std::max(largest_, outcome.largest);
                largest_kept_ = std::max(largest_kept_, outcome.largest_kept);
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
