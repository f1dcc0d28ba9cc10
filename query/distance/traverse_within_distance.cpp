#include "query/distance/traverse_within_distance.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <span>
#include <vector>

#include "query/distance/element_error.h"
#include "query/distance/node_errors.h"
#include "query/march/local_mesh.h"
#include "query/march/vertex_key.h"
#include "query/traverse/each_leaf.h"
#include "query/traverse/far/element_scout.h"
#include "query/traverse/far/given_ahead.h"
#include "store/base/in_order.h"
#include "store/container/indicator_code.h"

namespace isonest::detail {
namespace {

/// Of the cubes that are worked on by themselves.
constexpr int kBlockLevel = 5;
static_assert(3 * kBlockLevel < NodeErrors::kHeights);
/// Levels above these at which cubes are that are taken one after the other, so that few blocks are
/// known at a time.
constexpr int kGroupLevels = 4;

/// What the stop test asks for; no store has an indicator of that name.
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
    [[nodiscard]] bool stops(const Element<3>& /*t*/, double distance) const {
        return distance <= limit;
    }
};

/// What both traversals have in common.
struct Grid {
    ChunkCache& cache;
    const TraversalQuery& query;
    InBox region{query.box};
    HoldsIsovalue interest{query.iso, query.bound, cache.source().layout().header().spacing};

    [[nodiscard]] const Lattice& lattice() const { return cache.source().layout().lattice(); }
    [[nodiscard]] const Double3& spacing() const {
        return cache.source().layout().header().spacing;
    }
};

/// Calls visit(blocks) for the blocks with surface, group by group, from one thread. Where the
/// store is far, look(elements, coarsest, finest) announces what elements need, as look_ahead().
template <class Look, class Visit>
void for_groups(const Grid& grid, const char* phase, Progress& progress, const Look& look,
                const Visit& visit) {
    const int top = grid.lattice().top();
    const int group_level = std::min(top, kBlockLevel + kGroupLevels);
    const int block_level = std::min(top, kBlockLevel);
    const bool is_far = grid.cache.source().is_far();
    const auto looked_at = [&](std::span<const Element<3>> elements, int coarsest, int finest) {
        return is_far ? look(elements, coarsest, finest) : elements.size();
    };
    StoreNumbers numbers(grid.cache);
    AdaptTraverse<3, StoreNumbers, InBox, HoldsIsovalue, NothingStops> traversal(
        numbers, grid.region, grid.interest, NothingStops{});
    const auto nothing = [](const Element<3>&, double, Overlap) {};
    std::vector<Element<3>> groups;
    const std::vector<Element<3>> roots = traversal.roots(grid.lattice());
    looked_at(roots, top, group_level + 1);
    for (const Element<3>& t : roots) {
        traversal.above(t, group_level, nothing, groups);
    }
    progress.begin(phase, groups.size(), "");
    std::vector<Element<3>> blocks;
    std::size_t ahead = 0;
    GivenAhead given_groups;
    GivenAhead given_blocks;
    const auto take = [&](std::span<const Element<3>> left, int coarsest, int finest,
                          GivenAhead& given_ahead) {
        const std::size_t given = given_ahead.of(left.size());
        const std::size_t taken = looked_at(left.first(given), coarsest, finest);
        given_ahead.took(taken, given);
        return taken;
    };
    for (std::size_t g = 0; g < groups.size(); ++g) {
        progress.check();
        if (g == ahead) {
            ahead += take(std::span<const Element<3>>(groups).subspan(g), group_level,
                          block_level + 1, given_groups);
        }
        blocks.clear();
        traversal.above(groups[g], block_level, nothing, blocks);
        for (std::size_t first = 0; first < blocks.size();) {
            const auto left = std::span<const Element<3>>(blocks).subspan(first);
            const std::size_t count = take(left, block_level, 0, given_blocks);
            visit(left.first(count));
            first += count;
        }
        progress.advance(1);
    }
}

struct BlockErrors {
    std::vector<NodeError> errors;
    std::vector<NodeLink> links;
};

/// The distances of all elements of one block.
class BlockMeasure {
  public:
    BlockMeasure(const Grid& grid, double limit)
        : grid_(grid), numbers_(grid.cache), crossing_(grid.cache, grid.query.iso), limit_(limit) {}

    BlockErrors operator()(const Element<3>& block) {
        ElementErrors errors(grid_.spacing(), limit_);
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
        if (!grid_.interest.may_hold(t, numbers_.indicator(node, grid_.query.bound))) {
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
        return t.is_complete() ? element_polygon(t, grid_.query.iso, grid_.spacing(), crossing_)
                               : ElementPolygon{};
    }

    const Grid& grid_;
    StoreNumbers numbers_;
    FinestCrossing crossing_;
    double limit_;
    ElementErrors* errors_ = nullptr;
    BlockErrors found_;
};

/// See ElementScout.
struct NoLeaves {
    void operator()(const Element<3>& /*leaf*/, Wants& /*wants*/) const {}
};
using MeasureScout = ElementScout<3, StoreNumbers, InBox, HoldsIsovalue, NothingStops, NoLeaves>;

/// What the vertices of a leaf are made from.
class LeafNeeds {
  public:
    LeafNeeds(ChunkCache& cache, const TraversalQuery& query) : needs_(cache, query) {}
    void operator()(const Element<3>& leaf, Wants& wants) {
        for (std::size_t i = 0; leaf.is_complete() && i < 4; ++i) {
            for (std::size_t j = i + 1; j < 4; ++j) {
                needs_.edge(leaf.v[i], leaf.value[i], leaf.v[j], leaf.value[j], wants);
            }
        }
    }

  private:
    EdgeNeeds needs_;
};
using MarchScout = ElementScout<3, DistanceNumbers, InBox, HoldsIsovalue, StopsWithin, LeafNeeds>;

void measure(const Grid& grid, double limit, NodeErrors& errors, Progress& progress) {
    tbb::enumerable_thread_specific<BlockMeasure> measures(
        [&] { return BlockMeasure(grid, limit); });
    const auto look = [&](std::span<const Element<3>> elements, int coarsest, int finest) {
        // Nobody else holds chunks meanwhile.
        measures.clear();
        return look_ahead(grid.cache, nullptr, elements, coarsest, finest, false, [&] {
            return MeasureScout(grid.cache.source().layout(), StoreNumbers(grid.cache), grid.region,
                                grid.interest, NothingStops{}, {grid.query.bound}, NoLeaves{});
        });
    };
    for_groups(grid, "distances", progress, look, [&](std::span<const Element<3>> blocks) {
        in_order(
            static_cast<std::int64_t>(blocks.size()), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) {
                progress.check();
                return measures.local()(blocks[static_cast<std::size_t>(i)]);
            },
            [&](std::int64_t /*i*/, const BlockErrors& found) {
                errors.append(found.errors, found.links);
            });
    });
    errors.saturate();
}

/// Marches the leaves of blocks.
class BlockMarch {
  public:
    BlockMarch(const Grid& grid, const NodeErrors& errors, double limit, std::size_t part_vertices,
               const PartSink& sink)
        : numbers_(grid.cache, errors),
          traversal_(numbers_, grid.region, grid.interest, StopsWithin{limit}),
          query_(grid.query),
          part_vertices_(part_vertices),
          sink_(sink),
          attributes_(query_.attributes, grid.cache, query_.attribute_values),
          crossing_(grid.cache, query_.iso),
          mesh_(&attributes_, false, &crossing_) {}
    BlockMarch(const BlockMarch&) = delete;
    BlockMarch& operator=(const BlockMarch&) = delete;

    void block(const Element<3>& block, std::uint64_t order) {
        order_ = order;
        traversal_.subtree(block, *this);
        flush();
    }
    void operator()(const Element<3>& leaf, double distance, Overlap where) {
        ++counts_.leaves;
        counts_.error_bound = std::max(counts_.error_bound, distance);
        if (!leaf.is_complete()) {
            return;
        }
        std::array<Corner, 4> corners;
        for (std::size_t i = 0; i < 4; ++i) {
            corners[i] = {leaf.v[i], leaf.value[i]};
        }
        mesh_.march(corners, is_positive(leaf), query_.iso, where == Overlap::crossing);
        if (mesh_.size() >= part_vertices_) {
            flush();
        }
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.visited = traversal_.counts().visited;
        counts.value_rounding = attributes_.value_rounding();
        return counts;
    }

  private:
    void flush() {
        if (!mesh_.empty()) {
            sink_(order_++, mesh_.finish(query_.box));
        }
    }

    DistanceNumbers numbers_;
    AdaptTraverse<3, DistanceNumbers, InBox, HoldsIsovalue, StopsWithin> traversal_;
    const TraversalQuery& query_;
    std::size_t part_vertices_;
    const PartSink& sink_;
    AttributeSampler attributes_;
    FinestCrossing crossing_;
    LocalMesh mesh_;
    std::uint64_t order_ = 0;
    TraversalCounts counts_;
};

}  // namespace

std::uint64_t distance_traversal_heap(const StoreLayout& layout, const TraversalQuery& query) {
    std::uint64_t held = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        // Two samplers hold values of each level, one the bound.
        held += array.field == Field::values ? 2 * array.chunk_bytes()
                : array.field == query.bound ? array.chunk_bytes()
                                             : 0;
    }
    // What is found in a block, up to 32^3 elements, and handed on.
    constexpr std::uint64_t kBlock = std::uint64_t{8} << 20U;
    return held + kBlock;
}

TraversalCounts traverse_within_distance(ChunkCache& cache, const TraversalQuery& query,
                                         double limit, const ScratchFolder& folder,
                                         std::size_t part_vertices, const PartSink& sink,
                                         Progress& progress) {
    const Grid grid{cache, query};
    NodeErrors errors(folder);
    measure(grid, limit, errors, progress);
    tbb::enumerable_thread_specific<BlockMarch> marches(
        [&] { return BlockMarch(grid, errors, limit, part_vertices, sink); });
    // Numbers of parts: by group, block, and part of the block.
    constexpr unsigned kPartBits = 20;
    std::uint64_t number = 0;
    TraversalCounts counts;
    const auto add_counts = [&] {
        for (const BlockMarch& march : marches) {
            counts.add(march.counts());
        }
    };
    const auto look = [&](std::span<const Element<3>> elements, int coarsest, int finest) {
        add_counts();
        marches.clear();
        return look_ahead(cache, query.attribute_values, elements, coarsest, finest, true, [&] {
            return MarchScout(cache.source().layout(), DistanceNumbers(cache, errors), grid.region,
                              grid.interest, StopsWithin{limit}, {query.bound},
                              LeafNeeds(cache, query));
        });
    };
    for_groups(grid, "extract", progress, look, [&](std::span<const Element<3>> blocks) {
        tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t i) {
            progress.check();
            marches.local().block(blocks[i], (number + i) << kPartBits);
        });
        number += blocks.size();
    });
    add_counts();
    counts.bricks = number;
    return counts;
}

}  // namespace isonest::detail
