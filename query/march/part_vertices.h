// The vertices of one part while its triangles are collected, looked up by the place that they
// cross.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/march/clip.h"
#include "query/march/mesh_part.h"
#include "query/march/vertex_attributes.h"

namespace isonest::detail {

// Lookup of nodes and edges of a lattice: a table within a brick, hashing elsewhere.

/// A number for each node and each midpoint of an edge of a lattice. Points are twice the nodes, or
/// sums of the ends of edges. Not thread-safe.
class PointTable {
  public:
    static constexpr std::uint32_t kNone = 0xFFFFFFFFU;
    /// Bytes of the table for a box of `cells`^3.
    static constexpr std::uint64_t bytes(std::uint64_t cells) {
        return (cells + 1) * (cells + 1) * (cells + 1) * kPoints * sizeof(std::uint32_t);
    }

    /// From now on only points in the box of `cells` starting at node `low` are used; this avoids
    /// hashing. REQUIRES: empty.
    void place(const Int3& low, const Int3& cells) {
        low_ = low * 2;
        nodes_ = cells + Int3{1, 1, 1};
        const auto size = static_cast<std::size_t>(nodes_.product()) * kPoints;
        if (table_.size() < size) {
            table_.resize(size, kNone);
        }
    }

    /// The number at a point; if it is kNone, the caller must set it. The reference is valid until
    /// the next call.
    [[nodiscard]] std::uint32_t& at(const Int3& p) {
        if (table_.empty()) {
            return hashed(p);
        }
        const Int3 q = p - low_;
        const std::size_t index =
            static_cast<std::size_t>(nodes_.linear({q.x >> 1, q.y >> 1, q.z >> 1})) * kPoints +
            static_cast<std::size_t>((q.x & 1) + 2 * (q.y & 1) + 4 * (q.z & 1));
        if (table_[index] == kNone) {
            fill(static_cast<std::uint32_t>(index));
        }
        return table_[index];
    }

    /// Resets all points to kNone.
    void clear() {
        for (const std::uint32_t index : filled_) {
            table_[index] = kNone;
        }
        filled_.clear();
        elsewhere_.clear();
    }

  private:
    /// A node and the midpoints of the seven kinds of edges from it.
    static constexpr std::size_t kPoints = 8;

    // Rarely called, and kept out of at(), which is called for every corner of every triangle.
    [[gnu::noinline]] std::uint32_t& hashed(const Int3& p) {
        return elsewhere_.try_emplace(half_lattice_key(p), kNone).first.value();
    }
    [[gnu::noinline]] void fill(std::uint32_t index) { filled_.push_back(index); }

    Int3 low_;  ///< twice the box's first node
    Int3 nodes_;
    std::vector<std::uint32_t> table_;
    std::vector<std::uint32_t> filled_;
    tsl::robin_map<std::uint64_t, std::uint32_t, HalfLatticeHash> elsewhere_;
};

inline Double3 as_point(const Int3& p) {
    return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

/// A cube of the lattice of PartVertices::place(). Its corners are numbered as in cube_cases.h.
struct Cube {
    Int3 low;             ///< node
    unsigned mirror = 0;  ///< axes (bits x, y, z) along which its all-even corner is the high
                          ///< corner
    unsigned below = 0;   ///< corners below the isovalue (bits 0 to 7)
    std::array<double, 8> value{};  ///< REQUIRES: finite where it is marched
};

/// Edges opposite a node in the faces of the eight cubes around it. A node has fewer, but of
/// different kinds at different nodes.
inline constexpr std::uint8_t kLinkEdges = 98;

/// Nodes are those of a lattice of edge 2^level; positions and names are in coordinates of the
/// finest lattice. Vertices are numbered from 0. Several names can belong to one vertex: then the
/// lowest number is used. Not thread-safe.
class PartVertices {
  public:
    /// `attributes` and `finest` (may be null) must outlive the vertices. `finest`: determines the
    /// position of vertices on edges; null: linear between the ends.
    explicit PartVertices(AttributeSampler* attributes, FinestCrossing* finest = nullptr)
        : attributes_(attributes != nullptr && attributes->width() > 0 ? attributes : nullptr),
          finest_(finest) {}

    /// From now on all nodes are of the lattice of edge 2^level, in the box of `cells` starting at
    /// node `low`; see PointTable::place. Before, the lattice is the finest. REQUIRES: empty.
    void place(const Int3& low, int level, const Int3& cells) {
        level_ = level;
        points_.place(low, cells);
    }
    void clear();

    /// The vertex where the surface crosses the edge from a to b. The values must differ.
    std::uint32_t edge(const Int3& a, double a_value, const Int3& b, double b_value, double iso);
    /// The position of such a vertex, linear between the ends, without creating it; bit for bit the
    /// same.
    struct OnEdge {
        Int3 from;  ///< the edge's ends in the finest lattice, in a defined order
        Int3 to;
        double t;  ///< the vertex is from + t (to - from)
        Double3 position;
    };
    [[nodiscard]] OnEdge on_edge(const Int3& a, double a_value, const Int3& b, double b_value,
                                 double iso) const;
    /// The same for an edge (kCubeEdge) of a cube. REQUIRES: place() was called.
    std::uint32_t edge_of_cube(const Cube& cube, std::size_t edge, double iso);
    /// The vertex at a node through which at most one sheet passes, or at `height` (z) there. Do
    /// not combine with fan() at the same node.
    std::uint32_t node(const Int3& node, std::optional<double> height = {});
    /// The sheet at `node` that crosses two faces of one tetrahedron. `in`, `out`: for each face
    /// the sum of its other two nodes.
    std::uint32_t fan(const Int3& node, const Int3& in, const Int3& out);
    /// The middle of edge ab, for the sheet that runs along it above node `below`.
    std::uint32_t run(const Int3& a, const Int3& b, const Int3& below);
    /// The same, above two nodes of one tetrahedron.
    void run_between(const Int3& a, const Int3& b, const Int3& below1, const Int3& below2);
    /// A vertex used by no other tetrahedron: the centre of three vertices.
    std::uint32_t centre(const std::array<std::uint32_t, 3>& v);
    /// The same for any number of vertices.
    std::uint32_t centre(std::span<const std::uint32_t> v);
    /// The vertex where the faces `planes` (bits, as VertexKey::planes) of a closed box cut the
    /// edge from a to b, at a + t (b - a).
    std::uint32_t edge_cut(const Int3& a, const Int3& b, std::uint32_t planes, double t,
                           const Double3& position);
    /// The point `from` + t (`to` - `from`) between two vertices; used for attributes only.
    struct Between {
        std::uint32_t from;
        std::uint32_t to;
        double t;
    };
    /// The vertex where such faces cut a triangle of the grid.
    std::uint32_t face_cut(std::array<Int3, 3> face, std::uint32_t planes, const Between& between,
                           const Double3& position);
    /// A vertex used by no other tetrahedron.
    std::uint32_t inner_cut(const Between& between, const Double3& position);
    /// The vertex where the faces `planes` of a closed box cut hexahedra, in the edge, face or cell
    /// whose midpoint is half of `twice`; without planes, where the surface crosses a part of an
    /// edge. `attributes(AttributeSampler&)` is called if there are any. REQUIRES: level 0.
    template <class Attributes>
    std::uint32_t cell_cut(const Int3& twice, std::uint32_t planes, const Double3& position,
                           const Attributes& attributes);
    /// A node in coordinates of the finest lattice.
    [[nodiscard]] Int3 finest(const Int3& p) const { return p * (std::int64_t{1} << level_); }
    /// Makes root() available for all vertices. No vertices may be added until clear().
    void flatten();

    [[nodiscard]] std::size_t size() const { return parents_.size(); }
    /// Current size, in units of a vertex.
    [[nodiscard]] std::size_t weight() const {
        return parents_.size() + 2 * fans_.size() + runs_.size() + cuts_.size();
    }
    /// The number that represents the vertex. REQUIRES: flatten() was called.
    [[nodiscard]] std::uint32_t root(std::uint32_t v) const { return parents_[v]; }
    [[nodiscard]] const Double3& position(std::uint32_t v) const { return positions_[v]; }
    [[nodiscard]] VertexAttributes attributes(std::uint32_t v) const {
        return attributes_ != nullptr ? values_[v] : VertexAttributes{};
    }
    [[nodiscard]] std::size_t width() const {
        return attributes_ != nullptr ? attributes_->width() : 0;
    }
    /// Attributes of a vertex at a + t (b - a). REQUIRES: width() > 0.
    [[nodiscard]] VertexAttributes mix(const VertexAttributes& a, const VertexAttributes& b,
                                       double t) const {
        return attributes_->with_unit_normal(attributes_->mix(a, b, t));
    }
    static constexpr std::uint64_t kNoKey = 0xFFFFFFFFFFFFFFFFU;
    /// VertexKey::first of a vertex of kind edge; kNoKey for other kinds.
    [[nodiscard]] std::uint64_t key(std::uint32_t v) const { return keys_[v]; }
    /// Calls f(name, vertex) for names of kind fan and run that only one of the two tetrahedra at
    /// the face has used.
    template <class F>
    void for_incomplete(const F& f) const;
    /// Calls f(name, vertex) for all vertices where faces of a closed box cut edges and triangles.
    template <class F>
    void for_cuts(const F& f) const {
        for (const auto& [key, vertex] : cuts_) {
            f(key, vertex);
        }
    }

  private:
    /// The use of a name of kind fan or run: none yet (kNone); a vertex; or a vertex with
    /// kComplete, when two tetrahedra have used it.
    using Use = std::uint32_t;
    static constexpr std::uint32_t kNone = PointTable::kNone;
    static constexpr Use kComplete = 0x80000000U;
    /// The fans of a node, by the edges opposite it. `twice`: twice the node.
    struct FanLink {
        Int3 twice;
        std::array<Use, kLinkEdges> uses;
    };
    /// The runs along an edge, by twice the node below it.
    struct RunLink {
        static constexpr std::size_t kMax = 8;
        Int3 sum;  ///< of the edge's ends
        std::size_t count = 0;
        std::array<std::uint64_t, kMax> below{};
        std::array<Use, kMax> uses{};
    };

    /// Key of twice a node, or of the sum of an edge's ends.
    [[nodiscard]] std::uint64_t key_of(const Int3& p) const { return half_lattice_key(finest(p)); }
    [[nodiscard]] static OnEdge crossing(const FinestCrossing::Edge& edge, double iso);
    std::uint32_t add(std::uint64_t key, const Double3& position);
    std::uint32_t add_edge(const Int3& a, double a_value, const Int3& b, double b_value,
                           double iso);
    std::uint32_t add_node(const Int3& node);
    std::uint32_t add_middle(const Int3& a, const Int3& b);
    /// Number of the edge with that sum of ends among those around a node; kLinkEdges if there is
    /// none.
    [[nodiscard]] static std::size_t link_edge(const Int3& twice, const Int3& sum);
    [[nodiscard]] static Int3 offset_of(std::size_t link_edge);
    /// Null if the point's entry is used for something else.
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
    tsl::robin_map<VertexKey, Use, VertexKeyHash> rare_;  ///< names that do not fit into the links
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

// Converts the triangles that one thread has collected to a part that can be welded to others.

struct CollectedTriangle {
    std::array<std::uint32_t, 3> v;
    bool cut;  ///< it may extend beyond the box
};

/// The part inside the box. `lines`: the "triangles" are lines, with the last two corners equal.
/// Flattens the vertices and replaces the numbers in the triangles by roots.
MeshPart finish_part(PartVertices& vertices, std::vector<CollectedTriangle>& triangles, bool lines,
                     const ClipBox& box);

}  // namespace isonest::detail
