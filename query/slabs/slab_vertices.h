// The vertices of a slab, looked up by their edges of the lattice.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "query/march/cube_cases.h"
#include "query/march/part_vertices.h"
#include "query/march/vertex_attributes.h"
#include "query/slabs/slab_edges.h"
#include "query/slabs/slab_reader.h"
#include "query/values/topology.h"
#include "store/base/vectors.h"

namespace isonest::detail {

/// Vertices on lattice edges are numbered in the slab. Vertices at nodes, which are rare, are those
/// of a PartVertices, with the flag kOfLinks, until finish(). Edges are numbered like those of a
/// cell in kCubeEdge. One object can be used for any number of slabs, one after another. Not
/// thread-safe.
template <class T>
class SlabVertices {
  public:
    SlabVertices(const Int3& nodes, const SlabPlace& place, MarchedSlab& slab)
        : values_{nullptr, 0, nodes},
          gradient_(values_, place.steps),
          place_(place),
          slab_(slab),
          edges_(nodes),
          links_(nullptr),
          waiting_(gradient_) {}

    /// Starts cells with these values; there are no vertices yet.
    void begin(const SlabValues<T>& values) {
        values_ = values;
        forget();
    }
    /// Starts another part of the slab, from cells of row y of layer z on. Everything that other
    /// parts may also have is then recorded in the slab's `shared`.
    void begin_part(std::int64_t y, std::int64_t z) {
        forget();
        part_ = {true, y, z};
    }
    /// Starts the cells between planes z and z + 1. In ascending order, without gaps.
    void begin_layer(std::int64_t z) {
        z_ = z;
        edges_.begin_layer(z);
    }
    /// Starts the cells of this layer between rows y and y + 1. In ascending order; rows without
    /// surface may be skipped.
    void begin_row(std::int64_t y) {
        y_ = y;
        edges_.begin_row(y);
        for (std::size_t i = 0; i < 4; ++i) {
            const auto offset = static_cast<std::int64_t>(i);
            rows_[i] = values_.at({0, y + (offset & 1), z_ + (offset >> 1)});
        }
    }
    /// The value at a corner of cell x of the row.
    [[nodiscard]] double value(std::int64_t x, unsigned corner) const {
        return static_cast<double>(rows_[corner >> 1U][x + (corner & 1U)]);
    }
    /// The vertex on an edge of cell x of the row. REQUIRES: the surface crosses it.
    std::uint32_t on_edge(std::int64_t x, std::size_t edge) {
        std::uint32_t& slot = edges_.at(x, edge);
        if (slot == SlabEdges::kNone) {
            slot = add_on_edge(x, edge);
        }
        return slot;
    }

    /// Same interface as PartVertices, for PolygonWithHits.
    std::uint32_t edge_of_cube(const Cube& cube, std::size_t edge, double iso) {
        const CubeEdge& e = kCubeEdge[edge];
        const double t = crossing_of(cube.value[e.low], cube.value[e.high], iso);
        const std::uint32_t v = on_edge(cube.low.x, edge);
        recent_.push_back({v, on_edge_at(cube.low + corner_offset(e.low), axis_of(e), t)});
        return v;
    }
    std::uint32_t fan(const Int3& node, const Int3& in, const Int3& out) {
        const std::uint32_t v = links_.fan(node, in, out);
        add_link_normal(node, node, 0);
        return v | kOfLinks;
    }
    std::uint32_t run(const Int3& a, const Int3& b, const Int3& below) {
        const std::uint32_t v = links_.run(a, b, below);
        add_run_normal(a, b);
        return v | kOfLinks;
    }
    void run_between(const Int3& a, const Int3& b, const Int3& below1, const Int3& below2) {
        links_.run_between(a, b, below1, below2);
        add_run_normal(a, b);
    }
    /// REQUIRES: the vertex was requested since forget_positions().
    [[nodiscard]] const Double3& position(std::uint32_t v) const {
        if ((v & kOfLinks) != 0) {
            return links_.position(v & ~kOfLinks);
        }
        return std::find_if(recent_.begin(), recent_.end(),
                            [&](const Recent& r) { return r.vertex == v; })
            ->position;
    }
    void forget_positions() { recent_.clear(); }
    std::uint32_t centre(std::span<const std::uint32_t> v);

    /// The number of vertices plus the size of names of vertices at nodes, in units of a vertex.
    [[nodiscard]] std::size_t weight() const { return slab_.positions.size() + links_.weight(); }
    /// Records which edges of the first (0) or last plane have vertices. REQUIRES: the first or
    /// last layer is done.
    void keep_plane(std::size_t side) {
        edges_.for_plane(side, [&](std::uint64_t edge, std::uint32_t vertex) {
            slab_.on_plane[side].push_back({edge, vertex});
        });
    }
    /// Assigns numbers of the slab to vertices at nodes. No vertices may be added afterwards.
    void finish(const Slab& layers);
    /// The same for a part that ends with row y of cells of the layer.
    void finish_part(std::int64_t y);

  private:
    static constexpr std::uint32_t kOfLinks = 0x80000000U;
    struct Recent {
        std::uint32_t vertex;
        Double3 position;  ///< in the lattice
    };
    /// The current part of a slab, if any, and its first row of cells.
    struct Part {
        bool is = false;
        std::int64_t y = 0;
        std::int64_t z = 0;
    };

    void forget() {
        edges_.forget();
        links_.clear();
        link_normals_.clear();
        waiting_.clear();
        part_ = {};
    }
    /// Whether cells before the part's first one also have the edge.
    [[nodiscard]] bool is_in_earlier(const Int3& low, int axis) const {
        if (low.z == part_.z) {
            return axis != 2 || (low.y == part_.y && part_.y > 0);
        }
        return low.z == part_.z + 1 &&
               (axis == 0 ? part_.y > 0 && low.y <= part_.y : axis == 1 && low.y < part_.y);
    }
    void share(const Int3& low, int axis, std::uint32_t vertex) {
        Int3 middle = low * 2;
        ++middle[axis];
        slab_.shared.push_back({{half_lattice_key(middle), 0, VertexKind::edge}, vertex, true});
    }
    /// Appends the vertices at nodes to the others; returns the first.
    std::uint32_t append_links(std::vector<bool>& used);

    static int axis_of(const CubeEdge& e) { return (e.low ^ e.high) >> 1; }
    static Double3 on_edge_at(const Int3& low, int axis, double t) {
        Double3 p = as_point(low);
        p[static_cast<std::size_t>(axis)] += t;
        return p;
    }
    [[nodiscard]] std::array<float, 3> in_world(const Double3& p) const {
        const Double3 way = place_.steps.vector(p);
        std::array<float, 3> world{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            world[axis] = static_cast<float>(place_.origin[axis] + way[axis]);
        }
        return world;
    }
    /// At a + t (b - a); identical to AttributeSampler, bit for bit.
    [[nodiscard]] std::array<float, 3> normal(const Int3& a, const Int3& b, double t) const {
        std::array<float, 3> unit{};
        if (!place_.normals) {
            return unit;
        }
        const Double3 from = gradient_(a);
        const Double3 to = a == b ? from : gradient_(b);
        Double3 n{};
        for (std::size_t i = 0; i < 3; ++i) {
            n[i] = -(from[i] + t * (to[i] - from[i]));
        }
        return unit_normal(n);
    }
    /// The same on the edge from a node along `axis`, for the next vertex to be added; may be
    /// computed later.
    [[nodiscard]] std::array<float, 3> normal_on_edge(const Int3& low, int axis, double t) {
        if (!place_.normals) {
            return {};
        }
        if (!place_.steps.is_regular() || !gradient_.is_inner_edge(low, axis)) {
            Int3 high = low;
            ++high[axis];
            return normal(low, high, t);
        }
        if (waiting_.is_full()) {
            compute_waiting();
        }
        waiting_.add({values_.at(low), t, static_cast<std::uint32_t>(axis),
                      static_cast<std::uint32_t>(slab_.positions.size())});
        return {};
    }
    /// Computes all waiting normals; complete until the next vertex is added.
    [[gnu::noinline]] void compute_waiting() { waiting_.compute(slab_.normals); }
    std::uint32_t add(const Double3& position, const std::array<float, 3>& normal) {
        const auto next = static_cast<std::uint32_t>(slab_.positions.size());
        slab_.positions.push_back(in_world(position));
        if (place_.normals) {
            slab_.normals.push_back(normal);
        }
        return next;
    }
    [[gnu::noinline]] std::uint32_t add_on_edge(std::int64_t x, std::size_t edge) {
        const CubeEdge& e = kCubeEdge[edge];
        const double t = crossing_of(value(x, e.low), value(x, e.high), place_.iso);
        const Int3 low = Int3{x, y_, z_} + corner_offset(e.low);
        const bool is_alone = t > place_.sight && t < 1 - place_.sight;
        if (!is_alone) {
            add_not_alone();
        }
        const std::uint32_t v =
            add(on_edge_at(low, axis_of(e), t), normal_on_edge(low, axis_of(e), t));
        if (part_.is && is_in_earlier(low, axis_of(e))) {
            share(low, axis_of(e), v);
        }
        return v;
    }
    /// Marks the next vertex.
    void add_not_alone() {
        slab_.not_alone.push_back(static_cast<std::uint32_t>(slab_.positions.size()));
    }
    /// Call it after a request that may have made a vertex; does nothing if it did not.
    void add_link_normal(const Int3& a, const Int3& b, double t) {
        if (link_normals_.size() < links_.size()) {
            link_normals_.push_back(normal(a, b, t));
        }
    }
    void add_run_normal(const Int3& a, const Int3& b) {
        const bool in_order = a.z != b.z ? a.z < b.z : a.y != b.y ? a.y < b.y : a.x < b.x;
        add_link_normal(in_order ? a : b, in_order ? b : a, 0.5);
    }
    [[nodiscard]] const std::array<float, 3>& normal_of(std::uint32_t v) const {
        return (v & kOfLinks) != 0 ? link_normals_[v & ~kOfLinks] : slab_.normals[v];
    }

    SlabValues<T> values_;
    SlabGradient<T> gradient_;
    SlabPlace place_;
    MarchedSlab& slab_;
    SlabEdges edges_;
    std::int64_t z_ = 0;
    std::int64_t y_ = 0;
    Part part_;
    std::array<const T*, 4> rows_{};  ///< by the offsets along y and z (bits)
    PartVertices links_;
    std::vector<std::array<float, 3>> link_normals_;
    std::vector<Recent> recent_;
    EdgeNormals<T> waiting_;
};

/// As PartVertices::centre().
template <class T>
std::uint32_t SlabVertices<T>::centre(std::span<const std::uint32_t> v) {
    Double3 at{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (const std::uint32_t corner : v) {
            at[axis] += position(corner)[axis];
        }
        at[axis] /= static_cast<double>(v.size());
    }
    add_not_alone();
    if (!place_.normals) {
        return add(at, {});
    }
    compute_waiting();
    std::array<float, 3> mean = normal_of(v[0]);
    for (std::size_t i = 1; i < v.size(); ++i) {
        const double t = 1 / static_cast<double>(i + 1);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double a = mean[axis];
            const double b = normal_of(v[i])[axis];
            mean[axis] = static_cast<float>(a + t * (b - a));
        }
    }
    return add(at, unit_normal({mean[0], mean[1], mean[2]}));
}

template <class T>
std::uint32_t SlabVertices<T>::append_links(std::vector<bool>& used) {
    links_.flatten();
    const auto first = static_cast<std::uint32_t>(slab_.positions.size());
    for (std::uint32_t v = 0; v < links_.size(); ++v) {
        add_not_alone();
        add(links_.position(v), link_normals_[v]);
    }
    used.assign(links_.size(), false);
    for (auto& triangle : slab_.triangles) {
        for (std::uint32_t& v : triangle) {
            if ((v & kOfLinks) != 0) {
                const std::uint32_t root = links_.root(v & ~kOfLinks);
                used[root] = true;
                v = first + root;
            }
        }
    }
    return first;
}

template <class T>
void SlabVertices<T>::finish(const Slab& layers) {
    compute_waiting();
    if (links_.size() == 0) {
        return;
    }
    std::vector<bool> used;
    const std::uint32_t first = append_links(used);
    links_.for_incomplete([&](const VertexKey& key, std::uint32_t v) {
        const std::uint32_t root = links_.root(v);
        for (const std::size_t side : {0, 1}) {
            const std::int64_t plane = side == 0 ? layers.begin : layers.end;
            if (key.first >= half_lattice_key({0, 0, 2 * plane}) &&
                key.first < half_lattice_key({0, 0, 2 * plane + 1})) {
                slab_.named[side].push_back({key, first + root, used[root]});
            }
        }
    });
}

template <class T>
void SlabVertices<T>::finish_part(std::int64_t y) {
    compute_waiting();
    edges_.for_later(
        y, [&](const Int3& low, int axis, std::uint32_t vertex) { share(low, axis, vertex); });
    if (links_.size() == 0) {
        return;
    }
    std::vector<bool> used;
    const std::uint32_t first = append_links(used);
    links_.for_incomplete([&](const VertexKey& key, std::uint32_t v) {
        const std::uint32_t root = links_.root(v);
        slab_.shared.push_back({key, first + root, used[root]});
    });
}

}  // namespace isonest::detail
