#include "query/distance/traverse_within_distance.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <span>
#include <vector>

#include "query/distance/element_error.h"
#include "query/march/mesh_part.h"
#include "query/traverse/each_leaf.h"
#include "query/traverse/remote/look_ahead.h"
#include "store/base/in_order.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

/// Level of the cubes that are processed separately.
constexpr int kBlockLevel = 5;
static_assert(3 * kBlockLevel < NodeErrors::kHeights);
/// Number of levels above these at which cubes are processed one after another, so that few blocks
/// are known at a time.
constexpr int kGroupLevels = 4;

/// Field of the stop test; no store has an indicator of that name.
constexpr Field kDistance = Field::values;

std::uint64_t node_key(const Element<3>& t) {
    return half_lattice_key(t.ref_node_twice());
}

/// The numbers of a store, and the distances.
class DistanceNumbers {
  public:
    DistanceNumbers(ChunkCache& cache, const NodeErrors& errors) : store_(cache), errors_(errors) {}
    [[nodiscard]] double value(const Int3& p, int level) { return store_.value(p, level); }
    [[nodiscard]] double indicator(const Int3& p, Field field) {
        return field == kDistance ? errors_.at(half_lattice_key(p * 2))
                                  : store_.indicator(p, field);
    }

  private:
    StoreNumbers store_;
    const NodeErrors& errors_;
};

struct StopsWithin {
    double limit;
    [[nodiscard]] static std::optional<Field> field() { return kDistance; }
    template <class Numbers>
    [[nodiscard]] bool stops(const Element<3>& /*t*/, double distance, Numbers& /*numbers*/) const {
        return distance <= limit;
    }
};

/// Common data of both traversals.
struct Grid {
    explicit Grid(TraversalRun& of)
        : run(of),
          steps(run.layout().header().steps()),
          interest{run.query.iso, run.query.bound, steps} {}

    TraversalRun& run;
    LatticeSteps steps;
    InBox region{run.query.box};
    HoldsIsovalue interest;

    [[nodiscard]] const Lattice& lattice() const { return run.layout().lattice(); }
};

/// Calls visit(blocks) for the blocks with surface, group by group, from one thread. If the store
/// is remote, look(elements, coarsest, finest) prefetches what elements need, like look_ahead().
template <class Look, class Visit>
void for_groups(const Grid& grid, const char* phase, const Look& look, const Visit& visit) {
    using Elements = std::span<const Element<3>>;
    const int top = grid.lattice().top();
    const int group_level = std::min(top, kBlockLevel + kGroupLevels);
    const int block_level = std::min(top, kBlockLevel);
    const bool is_remote = grid.run.cache.source().is_remote();
    StoreNumbers numbers(grid.run.cache);
    AdaptTraverse<Element<3>, StoreNumbers, InBox, HoldsIsovalue, NothingStops> traversal(
        numbers, grid.region, grid.interest, NothingStops{});
    const auto nothing = [](const Element<3>&, double, Overlap) {};
    std::vector<Element<3>> groups;
    const std::vector<Element<3>> roots = traversal.roots(grid.lattice());
    if (is_remote) {
        look(roots, top, group_level + 1);
    }
    for (const Element<3>& t : roots) {
        traversal.above(t, group_level, nothing, groups);
    }
    grid.run.progress.begin(phase, groups.size(), "");
    std::vector<Element<3>> blocks;
    LookWindows of_groups(is_remote);
    LookWindows of_blocks(is_remote);
    of_groups.for_each(
        Elements(groups), [&](Elements next) { return look(next, group_level, block_level + 1); },
        [&](Elements window) {
            for (const Element<3>& group : window) {
                grid.run.progress.check();
                blocks.clear();
                traversal.above(group, block_level, nothing, blocks);
                of_blocks.for_each(
                    Elements(blocks), [&](Elements next) { return look(next, block_level, 0); },
                    visit);
                grid.run.progress.advance(1);
            }
        });
}

struct BlockErrors {
    std::vector<NodeError> errors;
    std::vector<NodeLink> links;
};

/// The distances of all elements of one block.
class BlockMeasure {
  public:
    BlockMeasure(const Grid& grid, double limit)
        : grid_(grid),
          numbers_(grid.run.cache),
          crossing_(grid.run.cache, grid.run.query.iso),
          limit_(limit) {}

    BlockErrors operator()(const Element<3>& block) {
        ElementErrors errors(grid_.steps, limit_);
        errors_ = &errors;
        found_ = {};
        visit(block);
        return std::move(found_);
    }

  private:
    std::int32_t visit(const Element<3>& t) {
        const Overlap where = grid_.region.overlap(t);
        if (where == Overlap::outside) {
            return ElementErrors::kNoSurface;
        }
        if (t.level == 0) {
            return errors_->add_finest(polygon(t));
        }
        const Int3 node = t.ref_node();
        if (!grid_.interest.may_hold(t, numbers_.indicator(node, grid_.run.query.bound),
                                     numbers_)) {
            return ElementErrors::kNoSurface;
        }
        const ElementErrors::Mark mark = errors_->mark(t);
        const auto halves = t.bisect(numbers_.value(node, t.level - 1));
        const std::array<std::int32_t, 2> children{visit(halves[0]), visit(halves[1])};
        const std::int32_t element =
            errors_->add(t, polygon(t), children, mark, where != Overlap::crossing);
        if (element == ElementErrors::kNoSurface) {
            return element;
        }
        const int height = ElementErrors::height_of(t);
        found_.errors.push_back({node_key(t), round_up_to_float(errors_->error(height, element))});
        for (std::size_t i = 0; i < 2 && height > 1; ++i) {
            if (children[i] != ElementErrors::kNoSurface) {
                found_.links.push_back({node_key(t), node_key(halves[i]), height - 1});
            }
        }
        return element;
    }
    ElementPolygon polygon(const Element<3>& t) {
        return t.is_complete() ? element_polygon(t, grid_.run.query.iso, grid_.steps, crossing_)
                               : ElementPolygon{};
    }

    const Grid& grid_;
    StoreNumbers numbers_;
    FinestCrossing crossing_;
    double limit_;
    ElementErrors* errors_ = nullptr;
    BlockErrors found_;
};

void measure(const Grid& grid, double limit, NodeErrors& errors) {
    TraversalRun& run = grid.run;
    tbb::enumerable_thread_specific<BlockMeasure> measures(
        [&] { return BlockMeasure(grid, limit); });
    const auto look = [&](std::span<const Element<3>> elements, int coarsest, int finest) {
        // No chunks are held meanwhile.
        measures.clear();
        return look_ahead(run.cache, nullptr, elements, coarsest, finest, false, [&] {
            return element_scout<Element<3>>(
                StoreNumbers(run.cache), grid.region, grid.interest, NothingStops{},
                SimplexNeeds(run, {run.query.bound}, LeafReads::nothing));
        });
    };
    for_groups(grid, "distances", look, [&](std::span<const Element<3>> blocks) {
        in_order(
            static_cast<std::int64_t>(blocks.size()), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) {
                run.progress.check();
                return measures.local()(blocks[static_cast<std::size_t>(i)]);
            },
            [&](std::int64_t /*i*/, const BlockErrors& found) {
                errors.append(found.errors, found.links);
            });
    });
    errors.saturate();
}

/// Marches the leaves of blocks.
class BlockMarch : public SubtreeMesh {
  public:
    BlockMarch(TraversalRun& run, const NodeErrors& errors)
        : SubtreeMesh(run), numbers_(run.cache, errors) {}

    [[nodiscard]] DistanceNumbers& numbers() { return numbers_; }
    void operator()(const Element<3>& leaf, double distance, Overlap where) {
        count_leaf(distance);
        if (!leaf.is_complete()) {
            return;
        }
        std::array<Corner, 4> corners;
        for (std::size_t i = 0; i < 4; ++i) {
            corners[i] = {leaf.v[i], leaf.value[i]};
        }
        mesh_.march(corners, is_positive(leaf), run_.query.iso, where == Overlap::crossing);
        flush_if_full();
    }

  private:
    DistanceNumbers numbers_;
};

TraversalCounts march_within(const Grid& grid, double limit, const NodeErrors& errors) {
    TraversalRun& run = grid.run;
    const StopsWithin stop{limit};
    using Worker = SubtreeWorker<Element<3>, HoldsIsovalue, StopsWithin, BlockMarch>;
    SubtreeWorkers<Worker> workers(
        [&] { return Worker(run, grid.interest, stop, [&] { return BlockMarch(run, errors); }); });
    const auto look = [&](std::span<const Element<3>> elements, int coarsest, int finest) {
        workers.leave();
        return look_ahead(run.cache, run.query.attribute_values, elements, coarsest, finest, true,
                          [&] {
                              return element_scout<Element<3>>(
                                  DistanceNumbers(run.cache, errors), grid.region, grid.interest,
                                  stop, SimplexNeeds(run, {run.query.bound}, LeafReads::edges));
                          });
    };
    std::uint64_t blocks_before = 0;
    for_groups(grid, "extract", look, [&](std::span<const Element<3>> blocks) {
        tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t i) {
            workers.local().subtree(blocks_before + i, blocks[i]);
        });
        blocks_before += blocks.size();
    });
    TraversalCounts counts = workers.counts();
    counts.bricks = blocks_before;
    return counts;
}

}  // namespace

std::uint64_t distance_traversal_heap(const StoreLayout& layout, Field bound) {
    std::uint64_t held = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        // Two samplers hold values of each level, one holds the bound.
        held += array.field == Field::values ? 2 * array.chunk_bytes()
                : array.field == bound       ? array.chunk_bytes()
                                             : 0;
    }
    // The results of a block, up to 32^3 elements.
    constexpr std::uint64_t kBlock = std::uint64_t{8} << 20U;
    return held + kBlock;
}

TraversalCounts traverse_within_distance(TraversalRun& run, double limit,
                                         const ScratchFolder& folder) {
    const Grid grid(run);
    NodeErrors errors(folder);
    measure(grid, limit, errors);
    return march_within(grid, limit, errors);
}

}  // namespace isonest::detail
