// The vertices of one part while its triangles are collected, found by what they are crossings of.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/march/finest_crossing.h"
#include "query/march/point_table.h"
#include "query/march/vertex_attributes.h"
#include "query/march/vertex_key.h"

namespace isonest::detail {

inline Double3 as_point(const Int3& p) {
    return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

/// A cube of the lattice of PartVertices::place(). Its corners are numbered as in cube_cases.h.
struct Cube {
    Int3 low;             ///< node
    unsigned mirror = 0;  ///< axes (bits x, y, z) along which its all-even corner is the high one
    unsigned below = 0;   ///< corners below the isovalue (bits 0 to 7)
    std::array<double, 8> value{};  ///< REQUIRES: finite in what is marched
};

/// Edges that are opposite to a node in the faces of the eight cubes around it: there are fewer,
/// but of different kinds at different nodes.
inline constexpr std::uint8_t kLinkEdges = 98;

/// Nodes are those of a lattice of edge 2^level; positions and names are in the finest one's
/// coordinates. Vertices are numbered from 0 on. Several names can be one vertex: then the lowest
/// number holds. Not thread-safe.
class PartVertices {
  public:
    /// `attributes` and `finest` (may be null) must outlive the vertices. `finest`: where vertices
    /// on edges are; null: linear between the ends.
    explicit PartVertices(AttributeSampler* attributes, FinestCrossing* finest = nullptr)
        : attributes_(attributes != nullptr && attributes->width() > 0 ? attributes : nullptr),
          finest_(finest) {}

    /// From now on all nodes are of the lattice of edge 2^level, and in the box of `cells` from
    /// node `low` on; see PointTable::place. Before, the lattice is the finest. REQUIRES: empty.
    void place(const Int3& low, int level, const Int3& cells) {
        level_ = level;
        points_.place(low, cells);
    }
    void clear();

    /// Where the surface crosses the edge from a to b, their values not being equal.
    std::uint32_t edge(const Int3& a, double a_value, const Int3& b, double b_value, double iso);
    /// The place of such a vertex, linear between the ends, without making it: the same bits.
    struct OnEdge {
        Int3 from;  ///< the edge's ends in the finest lattice, in an order of their own
        Int3 to;
        double t;  ///< the vertex is from + t (to - from)
        Double3 position;
    };
    [[nodiscard]] OnEdge on_edge(const Int3& a, double a_value, const Int3& b, double b_value,
                                 double iso) const;
    /// The same for an edge (kCubeEdge) of a cube. REQUIRES: place() was called.
    std::uint32_t edge_of_cube(const Cube& cube, std::size_t edge, double iso);
    /// In a node through which one sheet passes at most, or at `height` (z) there. Not together
    /// with fan() at one node.
    std::uint32_t node(const Int3& node, std::optional<double> height = {});
    /// The sheet at `node` that crosses two faces of one tetrahedron; `in`, `out`: for each the sum
    /// of the face's other two nodes.
    std::uint32_t fan(const Int3& node, const Int3& in, const Int3& out);
    /// The middle of edge ab, of the sheet that runs along it above node `below`.
    std::uint32_t run(const Int3& a, const Int3& b, const Int3& below);
    /// The same above two nodes of one tetrahedron.
    void run_between(const Int3& a, const Int3& b, const Int3& below1, const Int3& below2);
    /// One that no other tetrahedron names: the centre of three vertices.
    std::uint32_t centre(const std::array<std::uint32_t, 3>& v);
    /// The same of any number.
    std::uint32_t centre(std::span<const std::uint32_t> v);
    /// Where the faces `planes` (bits, as VertexKey::planes) of a closed box cut the edge from a to
    /// b, at a + t (b - a).
    std::uint32_t edge_cut(const Int3& a, const Int3& b, std::uint32_t planes, double t,
                           const Double3& position);
    /// At `from` + t (`to` - `from`), which are vertices; asked for attributes alone.
    struct Between {
        std::uint32_t from;
        std::uint32_t to;
        double t;
    };
    /// Where they cut a triangle of the grid.
    std::uint32_t face_cut(std::array<Int3, 3> face, std::uint32_t planes, const Between& between,
                           const Double3& position);
    /// One that no other tetrahedron names.
    std::uint32_t inner_cut(const Between& between, const Double3& position);
    /// Where the faces `planes` of a closed box cut hexahedra, in the edge, face or cell whose
    /// midpoint is half of `twice`; without planes, where the surface crosses a part of an edge.
    /// `attributes(AttributeSampler&)` is asked where there are some. REQUIRES: level 0.
    template <class Attributes>
    std::uint32_t cell_cut(const Int3& twice, std::uint32_t planes, const Double3& position,
                           const Attributes& attributes);
    /// A node in coordinates of the finest lattice.
    [[nodiscard]] Int3 finest(const Int3& p) const { return p * (std::int64_t{1} << level_); }
    /// Makes root() of all vertices known. No more vertices until clear().
    void flatten();

    [[nodiscard]] std::size_t size() const { return parents_.size(); }
    /// What is held, in units of a vertex.
    [[nodiscard]] std::size_t weight() const {
        return parents_.size() + 2 * fans_.size() + runs_.size() + cuts_.size();
    }
    /// The number that holds for the vertex. REQUIRES: flatten() was called.
    [[nodiscard]] std::uint32_t root(std::uint32_t v) const { return parents_[v]; }
    [[nodiscard]] const Double3& position(std::uint32_t v) const { return positions_[v]; }
    [[nodiscard]] VertexAttributes attributes(std::uint32_t v) const {
        return attributes_ != nullptr ? values_[v] : VertexAttributes{};
    }
    [[nodiscard]] std::size_t width() const {
        return attributes_ != nullptr ? attributes_->width() : 0;
    }
    /// Of a vertex at a + t (b - a). REQUIRES: width() > 0.
    [[nodiscard]] VertexAttributes mix(const VertexAttributes& a, const VertexAttributes& b,
                                       double t) const {
        return attributes_->with_unit_normal(attributes_->mix(a, b, t));
    }
    static constexpr std::uint64_t kNoKey = 0xFFFFFFFFFFFFFFFFU;
    /// VertexKey::first of a vertex of kind edge, kNoKey of another.
    [[nodiscard]] std::uint64_t key(std::uint32_t v) const { return keys_[v]; }
    /// Calls f(name, vertex) for names of kind fan and run that not both tetrahedra at the face
    /// have given.
    template <class F>
    void for_incomplete(const F& f) const;
    /// Calls f(name, vertex) for all that faces of a closed box cut out of edges and triangles.
    template <class F>
    void for_cuts(const F& f) const {
        for (const auto& [key, vertex] : cuts_) {
            f(key, vertex);
        }
    }

  private:
    /// What has a name of kind fan or run: nothing yet (kNone), a vertex, or a vertex and
    /// kComplete: then two tetrahedra have named it.
    using Use = std::uint32_t;
    static constexpr std::uint32_t kNone = PointTable::kNone;
    static constexpr Use kComplete = 0x80000000U;
    /// The fans of a node, by the edges opposite to it; `twice` the node.
    struct FanLink {
        Int3 twice;
        std::array<Use, kLinkEdges> uses;
    };
    /// The runs along an edge, by twice the node below.
    struct RunLink {
        static constexpr std::size_t kMost = 8;
        Int3 sum;  ///< of the edge's ends
        std::size_t count = 0;
        std::array<std::uint64_t, kMost> below{};
        std::array<Use, kMost> uses{};
    };

    /// Of twice a node, or the sum of an edge's ends.
    [[nodiscard]] std::uint64_t key_of(const Int3& p) const { return half_lattice_key(finest(p)); }
    [[nodiscard]] static OnEdge crossing(const FinestCrossing::Edge& edge, double iso);
    std::uint32_t add(std::uint64_t key, const Double3& position);
    std::uint32_t add_edge(const Int3& a, double a_value, const Int3& b, double b_value,
                           double iso);
    std::uint32_t add_node(const Int3& node);
    std::uint32_t add_middle(const Int3& a, const Int3& b);
    /// Number of the edge with that sum of ends among those around a node; kLinkEdges if it is
    /// none.
    [[nodiscard]] static std::size_t link_edge(const Int3& twice, const Int3& sum);
    [[nodiscard]] static Int3 offset_of(std::size_t link_edge);
    /// Null where something else has the point's place.
    FanLink* fan_link(const Int3& twice);
    Use& fan_use(const Int3& twice, const Int3& sum);
    Use& run_use(const Int3& sum, const Int3& below);
    template <class Make>
    std::uint32_t use(Use& use, const Make& make);
    template <class Make>
    std::uint32_t join(Use& a, Use& b, const Make& make);

    AttributeSampler* attributes_;
    FinestCrossing* finest_;
    int level_ = 0;
    PointTable points_;
    std::vector<FanLink> fans_;
    std::vector<RunLink> runs_;
    tsl::robin_map<VertexKey, Use, VertexKeyHash> rare_;  ///< what has no place in the links
    tsl::robin_map<VertexKey, std::uint32_t, VertexKeyHash> cuts_;
    std::vector<std::uint32_t> parents_;
    std::vector<std::uint64_t> keys_;
    std::vector<Double3> positions_;
    std::vector<VertexAttributes> values_;
};

template <class Attributes>
std::uint32_t PartVertices::cell_cut(const Int3& twice, std::uint32_t planes,
                                     const Double3& position, const Attributes& attributes) {
    const std::uint64_t key = half_lattice_key(twice);
    const auto next = static_cast<std::uint32_t>(size());
    if (planes == 0) {
        std::uint32_t& slot = points_.at(twice);
        if (slot != kNone) {
            return slot;
        }
        slot = next;
    } else if (const auto [it, is_new] =
                   cuts_.try_emplace(VertexKey{key, 0, VertexKind::cell, planes}, next);
               !is_new) {
        return it->second;
    }
    if (attributes_ != nullptr) {
        values_.push_back(attributes(*attributes_));
    }
    return add(planes == 0 ? key : kNoKey, position);
}

template <class F>
void PartVertices::for_incomplete(const F& f) const {
    const auto once = [](Use use) { return (use & kComplete) == 0; };
    for (const FanLink& link : fans_) {
        Use all = kNone;
        for (const Use use : link.uses) {
            all &= use;
        }
        for (std::size_t i = 0; i < kLinkEdges && once(all); ++i) {
            if (once(link.uses[i])) {
                const Int3 second = link.twice + offset_of(i);
                f(VertexKey{key_of(link.twice), key_of(second), VertexKind::fan}, link.uses[i]);
            }
        }
    }
    for (const RunLink& link : runs_) {
        for (std::size_t i = 0; i < link.count; ++i) {
            if (once(link.uses[i])) {
                f(VertexKey{key_of(link.sum), link.below[i], VertexKind::run}, link.uses[i]);
            }
        }
    }
    for (const auto& [key, use] : rare_) {
        if (once(use)) {
            f(key, use);
        }
    }
}

}  // namespace isonest::detail
