// Marching tetrahedra with exact hits.
//
// Sources: A. Doi, A. Koide, "An efficient method of triangulating equi-valued surfaces by using
// tetrahedral cells", IEICE Trans. E74 (1991) for the cases. The treatment of nodes that lie
// exactly on the surface is our own: each tetrahedron face with such a node, one node below and one
// not below is crossed by the surface in a segment from that node; the faces around a node that
// successive tetrahedra link form closed fans, and each fan is one vertex. So sheets that touch in
// a node stay separate, and the triangles that would have no area never arise.
#include "query/local_mesh.h"

#include <cmath>

#include "query/clip.h"

namespace isonest {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFFU;

Double3 as_point(const Int3& p) {
    return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

bool precedes(const Int3& a, const Int3& b) {
    return a.z != b.z ? a.z < b.z : a.y != b.y ? a.y < b.y : a.x < b.x;
}

/// A bijection on 64-bit numbers that leaves no pattern (the finaliser of MurmurHash3).
std::uint64_t scrambled(std::uint64_t h) {
    h = (h ^ (h >> 33U)) * 0xFF51AFD7ED558CCDULL;
    h = (h ^ (h >> 33U)) * 0xC4CEB9FE1A85EC53ULL;
    return h ^ (h >> 33U);
}

}  // namespace

std::uint32_t LocalMesh::root(std::uint32_t e) {
    while (elements_[e].parent != e) {
        elements_[e].parent = elements_[elements_[e].parent].parent;
        e = elements_[e].parent;
    }
    return e;
}

void LocalMesh::unite(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    elements_[std::max(a, b)].parent = std::min(a, b);
}

std::uint32_t LocalMesh::edge_vertex(const Corner& a, const Corner& b, double iso) {
    const std::uint64_t key = half_lattice_key(a.node + b.node);
    const auto next = static_cast<std::uint32_t>(elements_.size());
    const auto [it, inserted] = edges_.try_emplace(key, next);
    if (!inserted) {
        return it->second;
    }
    // The ends in a fixed order: the same bits from whichever tetrahedron.
    const bool in_order = precedes(a.node, b.node);
    const Corner& p = in_order ? a : b;
    const Corner& q = in_order ? b : a;
    double t = (iso - p.value) / (q.value - p.value);
    if (!std::isfinite(q.value - p.value)) {
        t = (iso / 4 - p.value / 4) / (q.value / 4 - p.value / 4);
    }
    const Double3 from = as_point(p.node);
    const Double3 to = as_point(q.node);
    Element element;
    element.key = {key, 0, VertexKind::edge};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        element.position[axis] = from[axis] + t * (to[axis] - from[axis]);
    }
    element.attributes = attributes_of(p.node, q.node, t);
    element.parent = next;
    elements_.push_back(element);
    return next;
}

template <class MakeAttributes>
std::uint32_t LocalMesh::token(const VertexKey& key, const Double3& position,
                               const MakeAttributes& attributes) {
    const auto next = static_cast<std::uint32_t>(elements_.size());
    const auto [it, inserted] = tokens_.try_emplace(key, next);
    if (inserted) {
        elements_.push_back({key, position, attributes(), next, 0});
    }
    ++elements_[it->second].uses;
    return it->second;
}

std::uint32_t LocalMesh::fan_token(const Int3& node, const Int3& second) {
    return token({half_lattice_key(node * 2), half_lattice_key(second), VertexKind::fan},
                 as_point(node), [&] { return attributes_at(node); });
}

std::uint32_t LocalMesh::run_token(const Corner& a, const Corner& b, const Corner& below) {
    const Double3 at = as_point(a.node + b.node);
    return token(
        {half_lattice_key(a.node + b.node), half_lattice_key(below.node * 2), VertexKind::run},
        {at[0] / 2, at[1] / 2, at[2] / 2}, [&] {
            return precedes(a.node, b.node) ? attributes_of(a.node, b.node, 0.5)
                                            : attributes_of(b.node, a.node, 0.5);
        });
}

/// The fan at `node` that enters this tetrahedron through the face (node, a0, b0) and leaves it
/// through (node, a1, b1).
std::uint32_t LocalMesh::fan(const Corner& node, const Corner& a0, const Corner& b0,
                             const Corner& a1, const Corner& b1) {
    if (single_sheet_) {
        return node_vertex(node.node, as_point(node.node));
    }
    const std::uint32_t in = fan_token(node.node, a0.node + b0.node);
    const std::uint32_t out = fan_token(node.node, a1.node + b1.node);
    unite(in, out);
    return in;
}

void LocalMesh::add(std::uint32_t a, std::uint32_t b, std::uint32_t c, bool cut) {
    triangles_.push_back({{a, b, c}, cut});
}

std::uint32_t LocalMesh::private_vertex(const Double3& position,
                                        const VertexAttributes& attributes) {
    const auto next = static_cast<std::uint32_t>(elements_.size());
    elements_.push_back({{0, 0, VertexKind::fan}, position, attributes, next, 2});
    return next;
}

/// Adds a triangle whose edge i, from corner i to i + 1, passes through mid[i] where that is a
/// vertex: none of them, one, or all three.
void LocalMesh::add_split(const std::array<std::uint32_t, 3>& v,
                          const std::array<std::uint32_t, 3>& mid, bool cut) {
    const int count = (mid[0] != kNone) + (mid[1] != kNone) + (mid[2] != kNone);
    if (count == 0) {
        return add(v[0], v[1], v[2], cut);
    }
    if (count == 1) {
        const std::size_t s = mid[0] != kNone ? 0 : mid[1] != kNone ? 1 : 2;
        add(v[s], mid[s], v[(s + 2) % 3], cut);
        return add(mid[s], v[(s + 1) % 3], v[(s + 2) % 3], cut);
    }
    // The whole triangle is a face of the grid, and the surface may pass through it on both sides
    // with the same six vertices; a centre of its own keeps the two apart.
    Double3 centre{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        centre[axis] = (elements_[v[0]].position[axis] + elements_[v[1]].position[axis] +
                        elements_[v[2]].position[axis]) /
                       3;
    }
    VertexAttributes mean{};
    for (std::size_t i = 0; i < mean.size(); ++i) {
        mean[i] = (elements_[v[0]].attributes[i] + elements_[v[1]].attributes[i] +
                   elements_[v[2]].attributes[i]) /
                  3;
    }
    const std::uint32_t c = private_vertex(centre, mean);
    for (std::size_t i = 0; i < 3; ++i) {
        add(c, v[i], mid[i], cut);
        add(c, mid[i], v[(i + 1) % 3], cut);
    }
}

void LocalMesh::march_one_below(const Corner& q, const std::array<Corner, 3>& above, bool positive,
                                double iso, bool cut) {
    // (q, above) positive: the triangle above0, above1, above2 faces away from q.
    const std::array<std::size_t, 3> order =
        positive ? std::array<std::size_t, 3>{0, 2, 1} : std::array<std::size_t, 3>{0, 1, 2};
    std::array<std::uint32_t, 3> v{};
    std::array<std::uint32_t, 3> mid{kNone, kNone, kNone};
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& a = above[order[i]];
        const Corner& b = above[order[(i + 1) % 3]];
        const Corner& c = above[order[(i + 2) % 3]];
        v[i] = a.value == iso ? fan(a, b, q, c, q) : edge_vertex(a, q, iso);
        if (a.value == iso && b.value == iso && !single_sheet_) {
            mid[i] = run_token(a, b, q);
        }
    }
    add_split(v, mid, cut);
}

void LocalMesh::march_two_below(const Corner& a, const Corner& b, const Corner& q1,
                                const Corner& q2, bool positive, double iso, bool cut) {
    const bool a_hit = a.value == iso;
    const bool b_hit = b.value == iso;
    if (a_hit && b_hit) {
        if (single_sheet_) {
            return;  // what else is there comes from other tetrahedra
        }
        fan(a, b, q1, b, q2);
        fan(b, a, q1, a, q2);
        unite(run_token(a, b, q1), run_token(a, b, q2));
        return;
    }
    // (a, b, q1, q2) positive: the quadrilateral a q1, a q2, b q2, b q1 faces q.
    const Corner& r1 = positive ? q1 : q2;
    const Corner& r2 = positive ? q2 : q1;
    if (a_hit) {
        const std::uint32_t at = fan(a, b, q1, b, q2);
        const std::uint32_t v2 = edge_vertex(b, r2, iso);
        return add(at, v2, edge_vertex(b, r1, iso), cut);
    }
    if (b_hit) {
        const std::uint32_t at = fan(b, a, q1, a, q2);
        const std::uint32_t v1 = edge_vertex(a, r1, iso);
        return add(v1, edge_vertex(a, r2, iso), at, cut);
    }
    const std::uint32_t a1 = edge_vertex(a, r1, iso);
    const std::uint32_t a2 = edge_vertex(a, r2, iso);
    const std::uint32_t b2 = edge_vertex(b, r2, iso);
    const std::uint32_t b1 = edge_vertex(b, r1, iso);
    add(a1, a2, b2, cut);
    add(a1, b2, b1, cut);
}

void LocalMesh::march(const std::array<Corner, 4>& corners, bool positive, double iso, bool cut) {
    std::array<std::size_t, 4> below{};
    std::array<std::size_t, 4> above{};
    std::size_t nb = 0;
    std::size_t na = 0;
    for (std::size_t i = 0; i < 4; ++i) {
        (corners[i].value < iso ? below[nb++] : above[na++]) = i;
    }
    if (nb == 0 || na == 0) {
        return;
    }
    // Bringing the corners into the order (below, above) or (above, below) is a permutation; its
    // parity says whether it turns the tetrahedron inside out.
    const auto parity = [](const std::array<std::size_t, 4>& p) {
        int inversions = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t j = i + 1; j < 4; ++j) {
                inversions += p[i] > p[j] ? 1 : 0;
            }
        }
        return (inversions & 1) != 0;
    };
    const auto at = [&](std::size_t i) -> const Corner& { return corners[i]; };
    if (nb == 1) {
        const bool flip = parity({below[0], above[0], above[1], above[2]});
        march_one_below(at(below[0]), {at(above[0]), at(above[1]), at(above[2])}, positive != flip,
                        iso, cut);
    } else if (nb == 2) {
        const bool flip = parity({above[0], above[1], below[0], below[1]});
        march_two_below(at(above[0]), at(above[1]), at(below[0]), at(below[1]), positive != flip,
                        iso, cut);
    } else if (at(above[0]).value != iso) {
        const bool flip = parity({above[0], below[0], below[1], below[2]});
        const bool outward = positive != flip;
        const Corner& a = at(above[0]);
        const std::uint32_t v0 = edge_vertex(a, at(below[0]), iso);
        const std::uint32_t v1 = edge_vertex(a, at(below[outward ? 1 : 2]), iso);
        add(v0, v1, edge_vertex(a, at(below[outward ? 2 : 1]), iso), cut);
    }
}

std::uint32_t LocalMesh::node_vertex(const Int3& node, const Double3& position) {
    const std::uint64_t key = half_lattice_key(node * 2);
    const auto next = static_cast<std::uint32_t>(elements_.size());
    const auto [it, inserted] = edges_.try_emplace(key, next);
    if (inserted) {
        elements_.push_back({{key, 0, VertexKind::edge}, position, attributes_at(node), next, 0});
    }
    return it->second;
}

void LocalMesh::march_line(const std::array<Corner, 3>& corners, double iso, bool cut) {
    lines_ = true;
    std::array<std::uint32_t, 2> ends{kNone, kNone};
    std::size_t count = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& a = corners[i];
        const Corner& b = corners[(i + 1) % 3];
        if ((a.value < iso) != (b.value < iso)) {
            const Corner& above = a.value < iso ? b : a;
            ends.at(count++) = above.value == iso ? node_vertex(above.node, as_point(above.node))
                                                  : edge_vertex(a, b, iso);
        }
    }
    if (count == 2 && ends[0] != ends[1]) {
        add(ends[0], ends[1], ends[1], cut);
    }
}

void LocalMesh::add_graph(const std::array<Corner, 3>& corners, bool cut) {
    const Int3 a = corners[1].node - corners[0].node;
    const Int3 b = corners[2].node - corners[0].node;
    const bool up = a.x * b.y - a.y * b.x > 0;
    std::array<std::uint32_t, 3> v{};
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& c = corners[i];
        Double3 position = as_point(c.node);
        position[2] = c.value;
        v[i] = node_vertex(c.node, position);
    }
    add(v[0], v[up ? 1 : 2], v[up ? 2 : 1], cut);
}

MeshPart LocalMesh::finish(const ClipBox& box) {
    // A vertex is complete if its triangles close up around it: then the neighbours that its
    // triangles enter and leave by are the same, and their (mixed) numbers cancel. An incomplete
    // one may continue in another part.
    std::vector<std::uint64_t> open(elements_.size(), 0);
    for (Triangle& t : triangles_) {
        for (std::uint32_t& v : t.v) {
            v = root(v);
        }
        for (std::size_t i = 0; i < 3; ++i) {
            open[t.v[i]] += scrambled(t.v[(i + 1) % 3]) - scrambled(t.v[(i + 2) % 3]);
        }
    }
    for (std::uint32_t e = 0; e < elements_.size(); ++e) {
        if (elements_[e].key.kind != VertexKind::edge && elements_[e].uses < 2) {
            open[root(e)] |= 1U;
        }
    }
    if (lines_) {
        std::fill(open.begin(), open.end(), 1);  // any end may go on in another part
    }
    MeshPart part;
    // First by element: which of them are shared, with their names.
    std::vector<std::uint32_t> shared(elements_.size(), kNone);
    const auto shared_of = [&](std::uint32_t e) {
        if (shared[e] == kNone) {
            shared[e] = static_cast<std::uint32_t>(part.shared.size());
            part.shared.emplace_back();
        }
        return shared[e];
    };
    std::vector<std::uint32_t> number(elements_.size(), kNone);
    std::vector<std::uint32_t> order;
    ClipContext clip(
        box, [&](std::uint32_t e) -> const Double3& { return elements_[e].position; },
        static_cast<std::uint32_t>(elements_.size()));
    const std::size_t width = attributes_ != nullptr ? attributes_->width() : 0;
    const std::function<VertexAttributes(std::uint32_t)> attributes = [&](std::uint32_t v) {
        if (v < elements_.size()) {
            return elements_[v].attributes;
        }
        const ClipContext::CutVertex& c = clip.vertex(v);
        return mix(attributes(c.from), attributes(c.to), c.t);
    };
    const auto vertex_of = [&](std::uint32_t v) {
        if (v >= number.size()) {
            number.resize(v + 1, kNone);
        }
        if (number[v] == kNone) {
            number[v] = static_cast<std::uint32_t>(part.positions.size());
            part.positions.push_back(v < elements_.size() ? elements_[v].position
                                                          : clip.position(v));
            if (width > 0) {
                const VertexAttributes a = attributes(v);
                part.attributes.insert(part.attributes.end(), a.begin(),
                                       a.begin() + static_cast<std::ptrdiff_t>(width));
            }
            order.push_back(v);
        }
        return number[v];
    };
    for (const Triangle& t : triangles_) {
        if (!t.cut) {
            part.triangles.push_back({vertex_of(t.v[0]), vertex_of(t.v[1]), vertex_of(t.v[2])});
            continue;
        }
        for (const auto& piece : clip.cut(t.v)) {
            if (lines_ && (piece[0] == piece[1] || piece[1] != piece[2])) {
                continue;  // what a flat triangle leaves beside its line
            }
            part.triangles.push_back(
                {vertex_of(piece[0]), vertex_of(piece[1]), vertex_of(piece[2])});
        }
    }
    // Shared elements with a vertex come first, in the order of the vertices.
    for (const std::uint32_t v : order) {
        if (v < elements_.size() ? open[v] != 0 : clip.is_shared(v, open)) {
            if (v >= shared.size()) {
                shared.resize(v + 1, kNone);
            }
            shared[v] = static_cast<std::uint32_t>(part.shared.size());
            part.shared.push_back({number[v]});
        }
    }
    for (const std::uint32_t v : order) {
        if (v >= elements_.size() && clip.is_shared(v, open)) {
            const ClipContext::CutVertex& c = clip.vertex(v);
            part.cuts.push_back({shared_of(c.end0), shared_of(c.end1), c.plane, shared[v]});
        }
    }
    for (std::uint32_t e = 0; e < elements_.size(); ++e) {
        const Element& element = elements_[e];
        const std::uint32_t r = root(e);
        const bool named = element.key.kind == VertexKind::edge ? open[e] != 0 : element.uses < 2;
        if (named && (open[r] != 0)) {
            part.names.push_back({element.key, shared_of(r)});
        }
    }
    edges_.clear();
    tokens_.clear();
    elements_.clear();
    triangles_.clear();
    return part;
}

}  // namespace isonest
