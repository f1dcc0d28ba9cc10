#include "query/traversal.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "query/brick_view.h"
#include "query/clip.h"
#include "query/finest_indicators.h"
#include "query/interest.h"
#include "query/morton.h"
#include "query/topology.h"
#include "store/error.h"

namespace isonest {
namespace {

/// One byte per cube in Morton order: the Kuhn tetrahedra that are to be refined.
using MaskList = std::vector<std::uint8_t>;

constexpr std::uint64_t kWholeProgress = std::uint64_t{1} << 40U;

struct Shared {
    ChunkCache& cache;
    const TraversalQuery& query;
    std::size_t part_vertices;
    const PartSink& sink;
    Progress& progress;
    tbb::enumerable_thread_specific<LocalMesh> meshes;
    tbb::enumerable_thread_specific<TraversalCounts> counts;
};

std::uint64_t order_of(int level, std::uint64_t morton) {
    return (static_cast<std::uint64_t>(63 - level) << 57U) | morton;
}

/// The work on one brick of level `level`: cubes of level + 1 whose tetrahedra are to be refined
/// come in, leaves are marched, and cubes of `level` whose tetrahedra are to be refined go out.
template <class T>
class BrickWork {
  public:
    BrickWork(Shared& shared, int level, const Int3& brick)
        : shared_(shared),
          query_(shared.query),
          mesh_(shared.meshes.local()),
          counts_(shared.counts.local()),
          level_(level),
          stride_(std::int64_t{1} << level),
          half_(shared.cache.source().layout().header().chunk / 2),
          base_(brick * shared.cache.source().layout().header().chunk) {
        const StoreLayout& layout = shared.cache.source().layout();
        values_ = ChunkGroup(shared.cache, layout.array(level, Field::values), base_);
        const Int3 parents = brick * half_;
        one_field_ = query_.stop == query_.bound;
        if (level > 0 && level < layout.lattice().top()) {
            stop_ = IndicatorView(shared.cache, layout.array(level + 1, query_.stop), parents);
            bound_ = IndicatorView(shared.cache, layout.array(level + 1, query_.bound), parents);
        }
        if (level > 0) {
            for (int octant = 0; octant < 8; ++octant) {
                const Int3 o{octant & 1, (octant >> 1) & 1, octant >> 2};
                const auto i = static_cast<std::size_t>(octant);
                centre_base_[i] = base_ + o * half_;
                centre_stop_[i] =
                    IndicatorView(shared.cache, layout.array(level, query_.stop), centre_base_[i]);
                centre_bound_[i] =
                    IndicatorView(shared.cache, layout.array(level, query_.bound), centre_base_[i]);
            }
        }
    }

    /// All cubes of the brick that `parents` (in Morton order) activates.
    void refine_parents(const MaskList& parents);
    /// The coarsest cube itself.
    void root();

    /// What child brick `octant` has to do; null if nothing.
    [[nodiscard]] std::unique_ptr<MaskList> take_children(int octant) {
        return std::move(children_[static_cast<std::size_t>(octant)]);
    }

  private:
    struct Nodes {
        CubeValues value;
        Int3 low;         ///< of the parent cube, in nodes of level_
        unsigned mirror;  ///< axes along which the topology tables are mirrored
        Sides sides;      ///< anything, until sharpen()
        bool sharp;
        bool cut;
    };
    void load(Nodes& nodes, const Int3& parent);
    void refine(const Int3& parent, std::uint8_t mask);
    void face(Nodes& nodes, int index);
    void edge(Nodes& nodes, int index);
    void subcube(const Nodes& nodes, int corner, std::uint8_t mask);
    /// Of a face or edge, above level 0.
    [[nodiscard]] double indicator(IndicatorView& view, const Nodes& nodes, int position) {
        const Int3 p = (nodes.low - base_) + node_offset(position, nodes.mirror);
        return view.at({p.x >> 1, p.y >> 1, p.z >> 1}, slot_of(p));
    }
    void sharpen(Nodes& nodes);
    [[nodiscard]] bool interesting(const Nodes& nodes, const TopologyTetrahedron& t, double beta) {
        ++counts_.visited;
        return level_ == 0 ? nodes.sides.both_in(t) : may_cross(nodes.value, t, beta, query_.iso);
    }
    [[nodiscard]] std::size_t octant_of(const Int3& local) const {
        return static_cast<std::size_t>((local.x >= half_ ? 1 : 0) + (local.y >= half_ ? 2 : 0) +
                                        (local.z >= half_ ? 4 : 0));
    }
    /// The interest and stop tests of a face's or edge's tetrahedron; marches it if it is a leaf.
    /// Without a tolerance no node stops, and none is asked.
    [[nodiscard]] bool refines(Nodes& nodes, const TopologyTetrahedron& t);
    void march(const Nodes& nodes, const TopologyTetrahedron& t, double eta, bool cut);
    void flush();

    Shared& shared_;
    const TraversalQuery& query_;
    LocalMesh& mesh_;
    TraversalCounts& counts_;
    int level_;
    std::int64_t stride_;
    std::int64_t half_;
    Int3 base_;  ///< first node of the brick, in nodes of level_
    bool one_field_ = true;
    ChunkGroup values_;
    IndicatorView stop_;
    IndicatorView bound_;
    std::array<Int3, 8> centre_base_;
    std::array<IndicatorView, 8> centre_stop_;
    std::array<IndicatorView, 8> centre_bound_;
    std::array<std::uint8_t, 8> subcubes_{};  ///< masks of the parent's subcubes, in table order
    std::array<std::unique_ptr<MaskList>, 8> children_;
    std::uint64_t order_ = 0;
};

template <class T>
void BrickWork<T>::march(const Nodes& nodes, const TopologyTetrahedron& t, double eta, bool cut) {
    std::array<Corner, 4> corners;
    for (std::size_t i = 0; i < 4; ++i) {
        const int position = t.vertices[i];
        const double value = nodes.value[static_cast<std::size_t>(position)];
        if (!std::isfinite(value)) {
            return;
        }
        corners[i] = {(nodes.low + node_offset(position, nodes.mirror)) * stride_, value};
    }
    ++counts_.leaves;
    counts_.error_bound = std::max(counts_.error_bound, eta);
    const bool mirrored = ((nodes.mirror ^ (nodes.mirror >> 1U) ^ (nodes.mirror >> 2U)) & 1U) != 0;
    mesh_.march(corners, t.positive != mirrored, query_.iso, cut);
}

template <class T>
void BrickWork<T>::load(Nodes& nodes, const Int3& parent) {
    nodes.low = parent * 2;
    nodes.sides = {~0U, ~0U};
    nodes.sharp = false;
    nodes.mirror = mirror_of(parent);
    const Int3 last =
        shared_.cache.source().layout().array(level_, Field::values).nodes - Int3{1, 1, 1} - base_;
    for (int position = 0; position < 27; ++position) {
        // Beyond the lattice of this level (only there for a parent that reaches outside the
        // volume) the nearest node's value holds.
        const Int3 p = min(nodes.low - base_ + node_offset(position, nodes.mirror), last);
        nodes.value[static_cast<std::size_t>(position)] =
            static_cast<double>(values_.template at<T>(p));
    }
}

/// Finds out on which sides of the isovalue the finest function can be. Above level 0 that takes
/// the indicators of the subcubes, which only a query without a tolerance is sure to need.
template <class T>
void BrickWork<T>::sharpen(Nodes& nodes) {
    std::array<double, 8> bound{};
    if (level_ > 0) {
        const std::size_t octant = octant_of(nodes.low - base_);
        for (unsigned corner = 0; corner < 8; ++corner) {
            const unsigned at = corner ^ nodes.mirror;
            const Int3 cube = nodes.low + Int3{at & 1U, (at >> 1U) & 1U, (at >> 2U) & 1U};
            bound[corner] = centre_bound_[octant].at(cube - centre_base_[octant], kCentreSlot);
        }
    }
    nodes.sides = sides_of(nodes.value, bound, query_.iso);
    nodes.sharp = true;
}

template <class T>
bool BrickWork<T>::refines(Nodes& nodes, const TopologyTetrahedron& t) {
    ++counts_.visited;
    if (!nodes.sides.both_in(t)) {
        return false;
    }
    if (query_.epsilon <= 0) {
        return true;
    }
    double eta = 0;
    if (level_ == 0) {
        eta = finest_indicator(nodes.value, t.ref_node, query_.stop == Field::linf_plus);
    } else {
        const double beta = indicator(bound_, nodes, t.ref_node);
        if (!may_cross(nodes.value, t, beta, query_.iso)) {
            return false;
        }
        eta = one_field_ ? beta : indicator(stop_, nodes, t.ref_node);
    }
    if (eta < query_.epsilon) {
        march(nodes, t, eta, nodes.cut);
        return false;
    }
    return true;
}

template <class T>
void BrickWork<T>::edge(Nodes& nodes, int index) {
    const TopologyTetrahedron& t = topology().edge[static_cast<std::size_t>(index)];
    if (!refines(nodes, t)) {
        return;
    }
    if (!nodes.sharp) {
        sharpen(nodes);
        if (!nodes.sides.both_in(t)) {
            return;
        }
    }
    for (std::size_t i = 0; i < 2; ++i) {
        subcubes_[t.children[i]] |= static_cast<std::uint8_t>(1U << t.child_orders[i]);
    }
}

template <class T>
void BrickWork<T>::face(Nodes& nodes, int index) {
    const TopologyTetrahedron& t = topology().face[static_cast<std::size_t>(index)];
    if (refines(nodes, t)) {
        edge(nodes, t.children[0]);
        edge(nodes, t.children[1]);
    }
}

template <class T>
void BrickWork<T>::subcube(const Nodes& nodes, int corner, std::uint8_t mask) {
    const unsigned at = static_cast<unsigned>(corner) ^ nodes.mirror;
    const Int3 cube = nodes.low + Int3{at & 1U, (at >> 1U) & 1U, (at >> 2U) & 1U};
    bool cut = nodes.cut;
    if (cut) {
        const Overlap overlap = overlap_of(query_.box, cube * stride_, stride_);
        if (overlap == Overlap::outside) {
            return;
        }
        cut = overlap == Overlap::crossing;
    }
    double beta = 0;
    double eta = 0;
    std::size_t octant = 0;
    const Int3 local = cube - base_;
    if (level_ > 0) {
        octant = octant_of(local);
        const Int3 node = cube - centre_base_[octant];
        beta = centre_bound_[octant].at(node, kCentreSlot);
        eta = one_field_ ? beta : centre_stop_[octant].at(node, kCentreSlot);
    }
    const bool leaf = level_ == 0 || eta < query_.epsilon;
    std::uint8_t refined = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) == 0) {
            continue;
        }
        const TopologyTetrahedron& t = topology().subcube[static_cast<std::size_t>(corner)][order];
        if (!interesting(nodes, t, beta)) {
            continue;
        }
        if (leaf) {
            march(nodes, t, eta, cut);
        } else {
            refined |= static_cast<std::uint8_t>(1U << order);
        }
    }
    if (refined != 0) {
        auto& list = children_[octant];
        if (list == nullptr) {
            list = std::make_unique<MaskList>(static_cast<std::size_t>(half_ * half_ * half_));
        }
        (*list)[morton_code(cube - centre_base_[octant])] |= refined;
    }
}

template <class T>
void BrickWork<T>::refine(const Int3& parent, std::uint8_t mask) {
    const Overlap overlap = overlap_of(query_.box, parent * (2 * stride_), 2 * stride_);
    if (overlap == Overlap::outside) {
        return;
    }
    Nodes nodes;
    load(nodes, parent);
    if (level_ == 0 || query_.epsilon <= 0) {
        sharpen(nodes);
    }
    nodes.cut = overlap == Overlap::crossing;
    subcubes_.fill(0);
    for (std::size_t order = 0; order < 6; ++order) {
        // The finer values say more than the bound by which the level above asked for this one.
        if ((mask >> order & 1U) != 0 && nodes.sides.both_in(topology().cube[order])) {
            face(nodes, topology().cube[order].children[0]);
            face(nodes, topology().cube[order].children[1]);
        }
    }
    for (int corner = 0; corner < 8; ++corner) {
        if (const std::uint8_t active = subcubes_[static_cast<std::size_t>(corner)]; active != 0) {
            subcube(nodes, corner, active);
        }
    }
}

template <class T>
void BrickWork<T>::flush() {
    if (!mesh_.empty()) {
        shared_.sink(order_, mesh_.finish(query_.box));
    }
}

template <class T>
void BrickWork<T>::refine_parents(const MaskList& parents) {
    ++counts_.bricks;
    const Int3 first{base_.x / 2, base_.y / 2, base_.z / 2};
    for (std::size_t i = 0; i < parents.size(); ++i) {
        if (parents[i] == 0) {
            continue;
        }
        const Int3 parent = first + morton_point(i);
        if (mesh_.empty()) {
            order_ = order_of(level_, morton_code(parent));
        }
        refine(parent, parents[i]);
        if (mesh_.size() >= shared_.part_vertices) {
            flush();
        }
    }
    flush();
}

template <class T>
void BrickWork<T>::root() {
    const Int3 cells = shared_.cache.source().layout().lattice().cells_at(level_);
    if (cells.product() == 0) {
        return;  // a volume without thickness holds no tetrahedra
    }
    ++counts_.bricks;
    // The coarsest cube as subcube 0 of a parent that is never refined itself.
    Nodes nodes;
    load(nodes, {0, 0, 0});
    if (level_ == 0) {
        sharpen(nodes);
    }
    nodes.cut = true;
    order_ = order_of(level_, 0);
    subcube(nodes, 0, 0x3F);
    flush();
}

template <class T>
void run_brick(Shared& shared, int level, const Int3& brick, std::unique_ptr<MaskList> parents,
               std::uint64_t progress_share) {
    shared.progress.check();
    std::array<std::unique_ptr<MaskList>, 8> children;
    int count = 0;
    {
        BrickWork<T> work(shared, level, brick);
        if (parents != nullptr) {
            work.refine_parents(*parents);
        } else {
            work.root();
        }
        parents.reset();
        for (int octant = 0; octant < 8; ++octant) {
            children[static_cast<std::size_t>(octant)] = work.take_children(octant);
            count += children[static_cast<std::size_t>(octant)] != nullptr ? 1 : 0;
        }
    }
    if (count == 0) {
        shared.progress.advance(progress_share);
        return;
    }
    const ArrayInfo& values = shared.cache.source().layout().array(level - 1, Field::values);
    for (int octant = 0; octant < 8; ++octant) {
        if (children[static_cast<std::size_t>(octant)] != nullptr) {
            shared.cache.source().prefetch(
                values, brick * 2 + Int3{octant & 1, (octant >> 1) & 1, octant >> 2});
        }
    }
    tbb::task_group group;
    const std::uint64_t share = progress_share / static_cast<std::uint64_t>(count);
    shared.progress.advance(progress_share - share * static_cast<std::uint64_t>(count));
    for (int octant = 7; octant >= 0; --octant) {
        auto& list = children[static_cast<std::size_t>(octant)];
        if (list == nullptr) {
            continue;
        }
        const Int3 child = brick * 2 + Int3{octant & 1, (octant >> 1) & 1, octant >> 2};
        group.run(
            [&shared, level, child, share, masks = std::shared_ptr<MaskList>(std::move(list))] {
                run_brick<T>(shared, level - 1, child,
                             std::make_unique<MaskList>(std::move(*masks)), share);
            });
    }
    group.wait();
}

}  // namespace

TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress) {
    Shared shared{cache, query, part_vertices, sink, progress, {}, {}};
    const StoreLayout& layout = cache.source().layout();
    progress.begin("extract", kWholeProgress, "");
    dispatch(layout.header().type, [&](auto tag) {
        run_brick<typename decltype(tag)::type>(shared, layout.lattice().top(), {0, 0, 0}, nullptr,
                                                kWholeProgress);
    });
    TraversalCounts total;
    for (const TraversalCounts& c : shared.counts) {
        total.visited += c.visited;
        total.leaves += c.leaves;
        total.bricks += c.bricks;
        total.error_bound = std::max(total.error_bound, c.error_bound);
    }
    return total;
}

std::uint64_t brick_heap(const StoreLayout& layout, const TraversalQuery& query) {
    std::uint64_t heap = 8 * layout.array(0, Field::values).chunk_bytes();
    const auto k = static_cast<std::uint64_t>(layout.header().chunk);
    heap += 9 * k * k * k / 8;
    if (layout.lattice().top() > 0) {
        const std::uint64_t fields = query.stop == query.bound ? 1 : 2;
        heap += 16 * fields * layout.array(1, query.bound).chunk_bytes();
    }
    return heap;
}

}  // namespace isonest
