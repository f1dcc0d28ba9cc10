// AdaptTraverse within one brick: from cubes of the level above to leaves and to subcubes.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2, 4 and 6. The unit is a cube with a mask of
// its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "query/brick_view.h"
#include "query/clip.h"
#include "query/finest_indicators.h"
#include "query/interest.h"
#include "query/morton.h"
#include "query/target.h"
#include "query/topology.h"
#include "query/traversal.h"

namespace isonest {

/// One byte per cube in Morton order: the Kuhn tetrahedra that are to be refined.
using MaskList = std::vector<std::uint8_t>;

/// What the bricks of a traversal share.
struct Shared {
    ChunkCache& cache;
    const TraversalQuery& query;
    std::size_t part_vertices;
    const PartSink& sink;
    Progress& progress;
    Target target;
    tbb::enumerable_thread_specific<AttributeSampler> attributes;
    tbb::enumerable_thread_specific<LocalMesh> meshes;
    tbb::enumerable_thread_specific<TraversalCounts> counts;
};

/// Which eighth of a brick a cube lies in, counted from the brick's first.
inline Int3 octant_of(const Int3& local, std::int64_t half) {
    return {local.x >= half ? 1 : 0, local.y >= half ? 1 : 0, local.z >= half ? 1 : 0};
}
constexpr Int3 kOctants{2, 2, 2};

/// One field around a brick of level L: at the faces and edges of level L + 1, and at the centres
/// of level L.
class FieldView {
  public:
    FieldView() = default;
    FieldView(ChunkCache& cache, Field field, int level, const Int3& brick, std::int64_t half) {
        const StoreLayout& layout = cache.source().layout();
        // Above the finest level; there the values say it, but for fields that are stored.
        derived_ = level == 0 && centre_suffices_at_level_1(field);
        plus_ = saturation_of(field) == Saturation::plus;
        base_ = brick * (2 * half);
        half_ = half;
        if (!derived_ && level < layout.lattice().top()) {
            parents_ = IndicatorView(cache, layout.array(level + 1, field), brick * half);
        }
        for (int octant = 0; octant < 8 && level > 0; ++octant) {
            const Int3 o = kOctants.unlinear(octant);
            centres_[static_cast<std::size_t>(octant)] =
                IndicatorView(cache, layout.array(level, field), base_ + o * half);
        }
    }
    /// At node `position` of the cube with these values, a face or edge of level L + 1.
    [[nodiscard]] double at(const CubeValues& values, const Int3& low, unsigned mirror,
                            int position) {
        if (derived_) {
            return finest_indicator(values, position, plus_);
        }
        const Int3 p = (low - base_) + node_offset(position, mirror);
        return parents_.at({p.x >> 1, p.y >> 1, p.z >> 1}, slot_of(p));
    }
    /// At the centre of a cube of level L > 0 in this brick.
    [[nodiscard]] double centre(const Int3& cube) {
        const Int3 local = cube - base_;
        const Int3 o = octant_of(local, half_);
        return centres_[static_cast<std::size_t>(kOctants.linear(o))].at(local - o * half_,
                                                                         kCentreSlot);
    }

  private:
    bool derived_ = false;
    bool plus_ = false;
    Int3 base_;
    std::int64_t half_ = 0;
    IndicatorView parents_;
    std::array<IndicatorView, 8> centres_;
};

inline std::uint64_t order_of(int level, std::uint64_t morton) {
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
          base_(brick * shared.cache.source().layout().header().chunk),
          bound_scale_(
              bound_scale(query_.bound, level, shared.cache.source().layout().header().spacing)),
          iso_(shared.target.level()) {
        const StoreLayout& layout = shared.cache.source().layout();
        values_ = ChunkGroup(shared.cache, layout.array(level, Field::values), base_);
        one_field_ = query_.stop == query_.bound;
        if (layout.lattice().top() > 0) {
            stop_ = FieldView(shared.cache, query_.stop, level, brick, half_);
            bound_ = FieldView(shared.cache, query_.bound, level, brick, half_);
            if (query_.culling) {
                culling_ = FieldView(shared.cache, query_.culling->field(), level, brick, half_);
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
        CubeValues value;          ///< the data
        CubeValues distance;       ///< of a plane, if one is marched
        const CubeValues* target;  ///< what is marched: one of the two
        Int3 low;                  ///< of the parent cube, in nodes of level_
        unsigned mirror;           ///< axes along which the topology tables are mirrored
        Sides sides;               ///< anything, until sharpen()
        bool sharp;
        bool cut;
    };
    void load(Nodes& nodes, const Int3& parent);
    void refine(const Int3& parent, std::uint8_t mask);
    void face(Nodes& nodes, int index);
    void edge(Nodes& nodes, int index);
    void subcube(const Nodes& nodes, int corner, std::uint8_t mask);
    /// How far the finest function can be from an element's, by the bound field at its refinement
    /// node. `kind`: bisections since the last whole cube.
    [[nodiscard]] double beta(double indicator, std::size_t kind) const {
        return shared_.target.is_plane() ? 0 : indicator * bound_scale_[kind];
    }
    [[nodiscard]] double stop_at(const Nodes& nodes, int position) {
        return stop_.at(nodes.value, nodes.low, nodes.mirror, position);
    }
    /// Whether the surface in the element and below it faces away from the viewer.
    [[nodiscard]] bool culled(const Nodes& nodes, const TopologyTetrahedron& t) {
        return query_.culling &&
               faces_away(nodes, t, culling_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node));
    }
    [[nodiscard]] bool faces_away(const Nodes& nodes, const TopologyTetrahedron& t,
                                  double beta) const {
        return query_.culling->faces_away(nodes.value, t, nodes.mirror, stride_, beta);
    }
    void sharpen(Nodes& nodes);
    [[nodiscard]] bool interesting(const Nodes& nodes, const TopologyTetrahedron& t, double beta) {
        ++counts_.visited;
        return level_ == 0 ? nodes.sides.both_in(t) : may_cross(*nodes.target, t, beta, iso_);
    }
    /// The interest and stop tests of a face's or edge's tetrahedron; marches it if it is a leaf.
    /// Without a tolerance no node stops, and none is asked.
    [[nodiscard]] bool refines(Nodes& nodes, const TopologyTetrahedron& t, std::size_t kind);
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
    FieldView stop_;
    FieldView bound_;
    FieldView culling_;
    std::array<double, 3> bound_scale_;
    double iso_;
    std::array<std::uint8_t, 8> subcubes_{};  ///< masks of the parent's subcubes, in table order
    std::array<std::unique_ptr<MaskList>, 8> children_;
    std::uint64_t order_ = 0;
};

template <class T>
void BrickWork<T>::march(const Nodes& nodes, const TopologyTetrahedron& t, double eta, bool cut) {
    std::array<Corner, 4> corners;
    for (std::size_t i = 0; i < 4; ++i) {
        const int position = t.vertices[i];
        const auto at = static_cast<std::size_t>(position);
        const double value = (*nodes.target)[at];
        if (!std::isfinite(nodes.value[at]) || !std::isfinite(value)) {
            return;
        }
        corners[i] = {(nodes.low + node_offset(position, nodes.mirror)) * stride_, value};
    }
    if (query_.culling && faces_away(nodes, t, 0)) {
        return;
    }
    ++counts_.leaves;
    counts_.error_bound = std::max(counts_.error_bound, eta);
    const bool mirrored = ((nodes.mirror ^ (nodes.mirror >> 1U) ^ (nodes.mirror >> 2U)) & 1U) != 0;
    mesh_.march(corners, t.positive != mirrored, iso_, cut);
}

template <class T>
void BrickWork<T>::load(Nodes& nodes, const Int3& parent) {
    nodes.low = parent * 2;
    nodes.sides = {~0U, ~0U};
    nodes.sharp = false;
    nodes.mirror = mirror_of(parent);
    const ArrayInfo& array = shared_.cache.source().layout().array(level_, Field::values);
    const Int3 last = array.nodes - Int3{1, 1, 1} - base_;
    const Int3 low = nodes.low - base_;
    const T* const near = values_.template within_first<T>(low, 2);
    const bool inside =
        near != nullptr && low.x + 2 <= last.x && low.y + 2 <= last.y && low.z + 2 <= last.z;
    for (int position = 0; position < 27; ++position) {
        const Int3 offset = node_offset(position, nodes.mirror);
        double& value = nodes.value[static_cast<std::size_t>(position)];
        if (inside) {
            value = static_cast<double>(near[array.chunk.linear(offset)]);
            continue;
        }
        // Beyond the lattice of this level (only there for a parent that reaches outside the
        // volume) the nearest node's value holds.
        value = static_cast<double>(values_.template at<T>(min(low + offset, last)));
    }
    nodes.target = &nodes.value;
    if (shared_.target.is_plane()) {
        nodes.distance = shared_.target.distances(nodes.low, nodes.mirror, stride_);
        nodes.target = &nodes.distance;
    }
}

/// Finds out on which sides of the isovalue the finest function can be. Above level 0 that takes
/// the indicators of the subcubes, which only a query without a tolerance is sure to need.
template <class T>
void BrickWork<T>::sharpen(Nodes& nodes) {
    std::array<double, 8> bound{};
    if (level_ > 0 && !shared_.target.is_plane()) {
        for (unsigned corner = 0; corner < 8; ++corner) {
            const unsigned at = corner ^ nodes.mirror;
            const Int3 cube = nodes.low + Int3{at & 1U, (at >> 1U) & 1U, (at >> 2U) & 1U};
            bound[corner] = beta(bound_.centre(cube), 0);
        }
    }
    nodes.sides = sides_of(*nodes.target, bound, iso_);
    nodes.sharp = true;
}

template <class T>
bool BrickWork<T>::refines(Nodes& nodes, const TopologyTetrahedron& t, std::size_t kind) {
    ++counts_.visited;
    if (!nodes.sides.both_in(t) || culled(nodes, t)) {
        return false;
    }
    if (query_.tolerance.is_zero()) {
        return true;
    }
    double eta = 0;
    if (level_ == 0 || shared_.target.is_plane()) {
        eta = stop_at(nodes, t.ref_node);
    } else {
        const double raw = bound_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node);
        if (!may_cross(*nodes.target, t, beta(raw, kind), iso_)) {
            return false;
        }
        eta = one_field_ ? raw : stop_at(nodes, t.ref_node);
    }
    const Int3 twice = (nodes.low + node_offset(t.ref_node, nodes.mirror)) * (2 * stride_);
    if (query_.tolerance.stops(eta, twice, 2 * stride_)) {
        march(nodes, t, eta, nodes.cut);
        return false;
    }
    return true;
}

template <class T>
void BrickWork<T>::edge(Nodes& nodes, int index) {
    const TopologyTetrahedron& t = topology().edge[static_cast<std::size_t>(index)];
    if (!refines(nodes, t, 2)) {
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
    if (refines(nodes, t, 1)) {
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
        const Overlap overlap =
            overlap_of(query_.box, cube * stride_, (cube + Int3{1, 1, 1}) * stride_);
        if (overlap == Overlap::outside) {
            return;
        }
        cut = overlap == Overlap::crossing;
    }
    double bound = 0;
    double eta = 0;
    bool leaf = level_ == 0;
    if (level_ > 0) {
        const bool exact = shared_.target.is_plane();
        bound = exact ? 0 : bound_.centre(cube);
        eta = one_field_ && !exact ? bound : stop_.centre(cube);
        leaf = !query_.tolerance.is_zero() &&
               query_.tolerance.stops(eta, (cube * 2 + Int3{1, 1, 1}) * stride_, stride_);
    }
    std::uint8_t refined = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) == 0) {
            continue;
        }
        const TopologyTetrahedron& t = topology().subcube[static_cast<std::size_t>(corner)][order];
        if (!interesting(nodes, t, beta(bound, 0))) {
            continue;
        }
        if (query_.culling && level_ > 0 && faces_away(nodes, t, culling_.centre(cube))) {
            continue;
        }
        if (leaf) {
            march(nodes, t, eta, cut);
        } else {
            refined |= static_cast<std::uint8_t>(1U << order);
        }
    }
    if (refined != 0) {
        const Int3 local = cube - base_;
        const Int3 octant = octant_of(local, half_);
        auto& list = children_[static_cast<std::size_t>(kOctants.linear(octant))];
        if (list == nullptr) {
            list = std::make_unique<MaskList>(static_cast<std::size_t>(half_ * half_ * half_));
        }
        (*list)[morton_code(local - octant * half_)] |= refined;
    }
}

template <class T>
void BrickWork<T>::refine(const Int3& parent, std::uint8_t mask) {
    const Overlap overlap =
        overlap_of(query_.box, parent * (2 * stride_), (parent + Int3{1, 1, 1}) * (2 * stride_));
    if (overlap == Overlap::outside) {
        return;
    }
    Nodes nodes;
    load(nodes, parent);
    if (level_ == 0 || query_.tolerance.is_zero() || shared_.target.is_plane()) {
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

}  // namespace isonest
