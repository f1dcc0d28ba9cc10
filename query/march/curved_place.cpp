#include "query/march/curved_place.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include <isonest/value_type.h>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

Double3 between(const Double3& a, const Double3& b, double t) {
    return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
}

Double3 difference(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double distance(const Double3& a, const Double3& b) {
    const Double3 d = difference(a, b);
    return hypot3(d[0], d[1], d[2]);
}

/// Positions of nodes. Holds the chunks that were used last. Not thread-safe.
template <class T>
class NodePlaces {
  public:
    explicit NodePlaces(ChunkCache& cache)
        : cache_(cache), arrays_(cache.source().layout().positions()), array_(arrays_[0]) {}

    [[nodiscard]] Double3 at(const Int3& p) {
        const Held& held = chunk(array_.chunk_of(p));
        const auto i = static_cast<std::size_t>(array_.chunk.linear(p - held.first));
        Double3 place{};
        for (std::size_t a = 0; a < 3; ++a) {
            place[a] = static_cast<double>(reinterpret_cast<const T*>(held.data[a].get())[i]);
        }
        return place;
    }
    /// The derivative of the position along the axes: central differences, one-sided at borders.
    [[nodiscard]] std::array<Double3, 3> derivative(const Int3& p) {
        std::array<Double3, 3> along{};
        for (int axis = 0; axis < 3; ++axis) {
            Int3 low = p;
            Int3 high = p;
            low[axis] = std::max<std::int64_t>(p[axis] - 1, 0);
            high[axis] = std::min(p[axis] + 1, array_.nodes[axis] - 1);
            const Double3 way = difference(at(high), at(low));
            const auto nodes = static_cast<double>(high[axis] - low[axis]);
            along[static_cast<std::size_t>(axis)] = {way[0] / nodes, way[1] / nodes,
                                                     way[2] / nodes};
        }
        return along;
    }
    /// Prefetches the chunks of the nodes in a box around each of the places.
    void prefetch(std::span<const Double3> places, std::int64_t around) {
        if (!cache_.source().is_remote()) {
            return;
        }
        ChunkNeeds needs;
        const Int3 last = array_.nodes - Int3{1, 1, 1};
        for (const Double3& place : places) {
            const Int3 cell{static_cast<std::int64_t>(place[0]),
                            static_cast<std::int64_t>(place[1]),
                            static_cast<std::int64_t>(place[2])};
            const Int3 by{around, around, around};
            const Int3 low = array_.chunk_of(max(cell - by, {0, 0, 0}));
            const Int3 high = array_.chunk_of(min(cell + by + Int3{1, 1, 1}, last));
            const Int3 size = high - low + Int3{1, 1, 1};
            for (std::int64_t i = 0; i < size.product(); ++i) {
                for (const ArrayInfo& array : arrays_) {
                    needs.add(array, low + size.unlinear(i));
                }
            }
        }
        cache_.prefetch(needs.chunks());
    }

  private:
    struct Held {
        Int3 chunk;
        Int3 first;
        std::array<DecodedChunk, 3> data;
    };

    const Held& chunk(const Int3& c) {
        const auto found = std::find_if(held_.begin(), held_.end(),
                                        [&](const Held& held) { return held.chunk == c; });
        if (found == held_.begin() && found != held_.end()) {
            return *found;
        }
        if (found != held_.end()) {
            std::rotate(held_.begin(), found, found + 1);
            return held_.front();
        }
        if (held_.size() == CurvedPlace::kMaxHeld) {
            held_.pop_back();
        }
        Held held{c, array_.first_node(c), {}};
        for (std::size_t a = 0; a < 3; ++a) {
            held.data[a] = cache_.get(arrays_[a], c);
        }
        return *held_.insert(held_.begin(), std::move(held));
    }

    ChunkCache& cache_;
    std::span<const ArrayInfo> arrays_;
    const ArrayInfo& array_;
    std::vector<Held> held_;  ///< most recently used first
};

/// A vertex between nodes: its place, and the weights of the nodes.
struct Mixed {
    struct Node {
        Int3 node;
        double weight;
        Double3 place;
    };
    Double3 place{};
    std::array<Node, 8> nodes{};
    std::size_t count = 0;

    void add(const Int3& node, double weight, const Double3& at) {
        nodes[count++] = {node, weight, at};
    }
};

/// The node before a place in the lattice, and the rest of the way to the place.
struct InCell {
    Int3 node;
    Double3 rest{};

    explicit InCell(const Double3& place) {
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double low = std::floor(place[a]);
            node[axis] = static_cast<std::int64_t>(low);
            rest[a] = place[a] - low;
        }
    }
};

/// Trilinear. Along axes without a rest, only one node has a weight.
template <class T>
Mixed on_cell(NodePlaces<T>& places, const InCell& in) {
    Mixed mixed;
    std::array<Double3, 8> at{};
    for (unsigned corner = 0; corner < 8; ++corner) {
        double weight = 1;
        Int3 node = in.node;
        for (unsigned axis = 0; axis < 3; ++axis) {
            const bool high = (corner >> axis & 1U) != 0;
            weight *= high ? in.rest[axis] : 1 - in.rest[axis];
            node[static_cast<int>(axis)] += high ? 1 : 0;
        }
        if (weight > 0) {
            at[corner] = places.at(node);
            mixed.add(node, weight, at[corner]);
        }
    }
    for (unsigned axis = 3; axis-- > 0;) {
        for (unsigned corner = 0; corner < 1U << axis; ++corner) {
            if (in.rest[axis] > 0) {
                at[corner] = between(at[corner], at[corner | 1U << axis], in.rest[axis]);
            }
        }
    }
    mixed.place = at[0];
    return mixed;
}

/// Linear on the six tetrahedra of the cell, which have an edge from the corner whose coordinates
/// are all even to the opposite one.
template <class T>
Mixed on_tetrahedron(NodePlaces<T>& places, const InCell& in) {
    struct Way {
        int axis;
        std::int64_t step;
        double length;  ///< from the even corner, in steps
    };
    Int3 node = in.node;
    std::array<Way, 3> ways{};
    std::size_t count = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double rest = in.rest[static_cast<std::size_t>(axis)];
        if (rest > 0) {
            const bool odd = in.node[axis] % 2 != 0;
            node[axis] += odd ? 1 : 0;
            ways[count++] = {axis, odd ? -1 : 1, odd ? 1 - rest : rest};
        }
    }
    std::stable_sort(ways.begin(), ways.begin() + static_cast<std::ptrdiff_t>(count),
                     [](const Way& a, const Way& b) { return a.length > b.length; });
    Mixed mixed;
    Double3 before = places.at(node);
    mixed.place = before;
    double reached = 1;
    for (std::size_t i = 0; i < count;) {
        const double length = ways[i].length;
        if (reached > length) {
            mixed.add(node, reached - length, before);
        }
        // Along a diagonal, all ways are equally long.
        constexpr double kSame = 1e-9;
        while (i < count && length - ways[i].length <= kSame) {
            node[ways[i].axis] += ways[i].step;
            ++i;
        }
        const Double3 next = places.at(node);
        const Double3 way = difference(next, before);
        for (std::size_t a = 0; a < 3; ++a) {
            mixed.place[a] += length * way[a];
        }
        before = next;
        reached = length;
    }
    mixed.add(node, reached, before);
    return mixed;
}

/// The normal in the world of a gradient in the lattice; 0 if it has no direction.
std::array<float, 3> in_world(const std::array<float, 3>& normal,
                              const std::array<Double3, 3>& derivative) {
    const Double3 x = cross(derivative[1], derivative[2]);
    const Double3 y = cross(derivative[2], derivative[0]);
    const Double3 z = cross(derivative[0], derivative[1]);
    const double determinant = dot(derivative[0], x);
    if (determinant == 0) {
        return {};
    }
    const double sign = determinant < 0 ? -1 : 1;
    Double3 n{};
    for (std::size_t a = 0; a < 3; ++a) {
        n[a] =
            sign * (static_cast<double>(normal[0]) * x[a] + static_cast<double>(normal[1]) * y[a] +
                    static_cast<double>(normal[2]) * z[a]);
    }
    return unit_normal(n);
}

bool is_near_face(const Double3& place, const ClipBox& box) {
    constexpr double kNear = 0.125;
    bool near = false;
    for (std::size_t a = 0; box.close && a < 3; ++a) {
        near = near || place[a] - box.lo[a] <= kNear || box.hi[a] - place[a] <= kNear;
    }
    return near;
}

}  // namespace

void CurvedPlace::place(MeshPart& part) const {
    if (cache_.source().layout().header().curved->type == ValueType::f32) {
        place_in<float>(part);
    } else {
        place_in<double>(part);
    }
}

template <class T>
void CurvedPlace::place_in(MeshPart& part) const {
    NodePlaces<T> places(cache_);
    places.prefetch(part.positions, placing_.has_normals ? 1 : 0);
    const std::size_t width =
        part.positions.empty() ? 0 : part.attributes.size() / part.positions.size();
    std::vector<std::uint32_t> may_meet;
    auto off_edge = part.off_edges.begin();
    part.world.reserve(part.positions.size());
    for (std::uint32_t v = 0; v < part.positions.size(); ++v) {
        const InCell in(part.positions[v]);
        const Mixed mixed =
            placing_.is_of_tetrahedra ? on_tetrahedron(places, in) : on_cell(places, in);
        const std::span nodes(mixed.nodes.data(), mixed.count);
        part.world.push_back({static_cast<float>(mixed.place[0]),
                              static_cast<float>(mixed.place[1]),
                              static_cast<float>(mixed.place[2])});
        const bool is_off = off_edge != part.off_edges.end() && *off_edge == v;
        off_edge += is_off ? 1 : 0;
        if (is_off || is_near_face(part.positions[v], placing_.box) ||
            (placing_.sight && std::any_of(nodes.begin(), nodes.end(), [&](const auto& node) {
                 return distance(node.place, mixed.place) <= *placing_.sight;
             }))) {
            may_meet.push_back(v);
        }
        if (placing_.has_normals) {
            std::array<Double3, 3> derivative{};
            for (const auto& node : nodes) {
                const std::array<Double3, 3> there = places.derivative(node.node);
                for (std::size_t i = 0; i < 9; ++i) {
                    derivative[i / 3][i % 3] += node.weight * there[i / 3][i % 3];
                }
            }
            std::array<float, 3> normal{};
            std::memcpy(normal.data(), &part.attributes[v * width], sizeof(normal));
            normal = in_world(normal, derivative);
            std::memcpy(&part.attributes[v * width], normal.data(), sizeof(normal));
        }
    }
    part.positions.clear();
    part.positions.shrink_to_fit();
    part.off_edges = std::move(may_meet);
    if (cache_.source().layout().header().curved->mirrored) {
        for (auto& t : part.triangles) {
            std::swap(t[1], t[2]);
        }
    }
}

}  // namespace isonest::detail
