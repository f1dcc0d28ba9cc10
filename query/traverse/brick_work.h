// AdaptTraverse within one brick: from cubes of the level above to leaves and to subcubes.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5. The unit is a cube with a mask of
// its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "query/traverse/interest.h"
#include "query/traverse/surface_cubes.h"
#include "query/traverse/target.h"
#include "query/traverse/topology.h"
#include "query/traverse/traversal.h"
#include "query/view/cube_nodes.h"
#include "query/view/field_view.h"

namespace isonest::detail {

/// Cells per axis of the blocks of a brick whose vertices lie in one table (PointTable).
inline std::int64_t table_cells(const StoreLayout& layout) {
    constexpr std::int64_t kMostCells = 32;
    return std::min<std::int64_t>(layout.header().chunk, kMostCells);
}

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
          parents_bound_scale_(bound_scale(query_.bound, level + 1,
                                           shared.cache.source().layout().header().spacing)),
          finest_(level == 0 && query_.tolerance.is_zero() && !query_.plane),
          plain_(finest_ && !query_.culling && !query_.on_leaf),
          ranged_(shared.cache.source().layout().has_cube_ranges(level) && !query_.plane),
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
        if (query_.attributes.width() > 0) {
            attributes_ = &shared.attributes.local();
            attributes_->enter(level, base_ * stride_);
        }
    }
    BrickWork(const BrickWork&) = delete;
    BrickWork& operator=(const BrickWork&) = delete;
    ~BrickWork() {
        if (attributes_ != nullptr) {
            attributes_->leave();
        }
    }

    /// All cubes of the brick that `parents` activates: masks in Morton order from cube `begin` on.
    void refine_parents(const MaskList& parents, std::size_t begin);
    /// The coarsest cube itself.
    void root();

    /// What child brick `octant` has to do; null if nothing.
    [[nodiscard]] std::unique_ptr<MaskList> take_children(int octant) {
        return std::move(children_[static_cast<std::size_t>(octant)]);
    }

  private:
    void load(CubeNodes& nodes, const Int3& parent) {
        isonest::detail::load<T>(nodes, parent, values_,
                                 shared_.cache.source().layout().array(level_, Field::values),
                                 base_, shared_.target, stride_);
    }
    void refine(const Int3& parent, std::uint8_t mask);
    void face(CubeNodes& nodes, int index);
    void edge(CubeNodes& nodes, int index);
    void subcube(const CubeNodes& nodes, int corner, std::uint8_t mask);
    /// How far the finest function can be from a subcube's elements, by the bound field at its
    /// centre.
    [[nodiscard]] double beta(double indicator) const {
        return shared_.target.is_plane() ? 0 : indicator * bound_scale_;
    }
    [[nodiscard]] double stop_at(const CubeNodes& nodes, int position) {
        return stop_.at(nodes.value, nodes.low, nodes.mirror, position);
    }
    /// Whether the surface in the element and below it faces away from the viewer.
    [[nodiscard]] bool culled(const CubeNodes& nodes, const TopologyTetrahedron& t) {
        return query_.culling &&
               faces_away(nodes, t, culling_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node));
    }
    [[nodiscard]] bool faces_away(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                  double beta) const {
        return query_.culling->faces_away(nodes.value, t, nodes.mirror, stride_, beta);
    }
    void sharpen(CubeNodes& nodes);
    /// The interest test of a tetrahedron of a parent cube, of any kind. `raw`: its bound field, if
    /// that was asked.
    [[nodiscard]] bool in_question(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                   double& raw);
    /// The stop test; marches the tetrahedron if it is a leaf. Without a tolerance no node stops,
    /// and none is asked.
    [[nodiscard]] bool is_leaf(CubeNodes& nodes, const TopologyTetrahedron& t, double raw);
    [[nodiscard]] bool edges_refine(CubeNodes& nodes, const TopologyTetrahedron& face);
    [[nodiscard]] std::uint8_t those_in_question(const CubeNodes& nodes, std::uint8_t mask);
    [[nodiscard]] std::uint8_t refined_to_subcubes(CubeNodes& nodes, std::uint8_t mask);
    void skip_to_subcubes(CubeNodes& nodes, const std::array<std::uint8_t, 8>& below);
    /// Whether the node at `position`, its stop field being eta, stops.
    [[nodiscard]] bool stops(const CubeNodes& nodes, int position, double eta) const {
        const Int3 twice = (nodes.low + node_offset(position, nodes.mirror)) * (2 * stride_);
        return query_.tolerance.stops(eta, twice, 2 * stride_);
    }
    void march(const CubeNodes& nodes, const TopologyTetrahedron& t, double eta, bool cut);
    void march_stopped(const CubeNodes& nodes, const TopologyTetrahedron& t, double bound,
                       double eta, bool cut);
    void hand_down(const Int3& cube, std::uint8_t mask);
    void place(const Int3& low);
    void march_subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask, bool cut);
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
    AttributeSampler* attributes_ = nullptr;
    double bound_scale_;
    double parents_bound_scale_;
    bool finest_;  ///< no coarser level was asked, every cube that the surface passes comes in
    bool plain_;   ///< whole cubes of the finest level are marched
    bool ranged_;  ///< cubes are excluded by what values there are in them
    double iso_;
    const Topology& topology_ = topology();
    std::array<std::uint8_t, 8> subcubes_{};  ///< masks of the parent's subcubes, in table order
    std::array<std::unique_ptr<MaskList>, 8> children_;
    std::uint64_t order_ = 0;
};

}  // namespace isonest::detail
