#include "query/march/capped_tetrahedron.h"

#include <algorithm>
#include <bit>
#include <cassert>

namespace isonest::detail {
namespace {

constexpr unsigned kAllCorners = 0xF;

std::size_t first_of(unsigned nodes) {
    return static_cast<std::size_t>(std::countr_zero(nodes));
}

}  // namespace

bool CappedTetrahedron::touches(const PartVertices& vertices,
                                const std::array<Corner, 4>& corners) {
    bool touched = false;
    inner_.fill(0);
    outer_.fill(0);
    for (unsigned i = 0; i < 4; ++i) {
        const Double3 p = as_point(vertices.finest(corners[i].node));
        for (std::uint32_t plane = 0; plane < kPlanes; ++plane) {
            const double d =
                (plane & 1U) == 0 ? p[plane / 2] - limit(plane) : limit(plane) - p[plane / 2];
            inner_[plane] |= (d > 0 ? 1U : 0U) << i;
            outer_[plane] |= (d < 0 ? 1U : 0U) << i;
            touched = touched || d <= 0;
        }
    }
    return touched;
}

bool CappedTetrahedron::is_far_from_faces(const Int3& node) const {
    const auto bits = static_cast<std::uint64_t>(node.x | node.y | node.z);
    if (bits == 0) {
        return false;
    }
    const auto reach = static_cast<double>(std::uint64_t{2} << std::countr_zero(bits));
    const Double3 p = as_point(node);
    bool far = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        far = far && p[axis] - box_.lo[axis] > reach && box_.hi[axis] - p[axis] > reach;
    }
    return far;
}

void CappedTetrahedron::begin(const PartVertices& vertices, const std::array<Corner, 4>& corners,
                              bool positive) {
    vertices_.clear();
    facets_.clear();
    corners_.clear();
    for (std::uint32_t i = 0; i < 4; ++i) {
        Vertex& v = vertices_.emplace_back();
        v.position = as_point(vertices.finest(corners[i].node));
        v.nodes = 1U << i;
        v.same = i;
    }
    constexpr std::array<std::array<std::uint32_t, 3>, 4> kOutward{
        {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};
    for (const auto& face : kOutward) {
        const std::size_t at = corners_.size();
        corners_.insert(corners_.end(), {face[0], face[positive ? 1 : 2], face[positive ? 2 : 1]});
        facets_.push_back({kNone, at, corners_.size()});
    }
}

/// Leaves what is inside. sides_ says what is; make(inside, outside) gives the vertex at which an
/// edge crosses `by`.
template <class Make>
void CappedTetrahedron::cut(std::uint32_t by, const Make& make) {
    cut_facets_.clear();
    cut_corners_.clear();
    crossings_.clear();
    const auto crossing = [&](std::uint32_t in, std::uint32_t out, std::uint32_t facet_cut) {
        auto found = std::find_if(crossings_.begin(), crossings_.end(), [&](const Crossing& c) {
            return c.inside == in && c.outside == out;
        });
        if (found == crossings_.end()) {
            const auto next = static_cast<std::uint32_t>(vertices_.size());
            Vertex made;
            if (sides_[out] == Side::on) {
                made = vertices_[out];  // its `same` stays
            } else {
                made = make(in, out);
                made.same = next;
                made.last = by;
                made.cuts = 1U << by;
            }
            vertices_.push_back(made);
            found = crossings_.insert(crossings_.end(), {in, out, next});
        }
        if (facet_cut != kNone && sides_[out] != Side::on) {
            vertices_[found->vertex].cuts |= 1U << facet_cut;
        }
        return found - crossings_.begin();
    };
    for (const Facet& facet : facets_) {
        const std::size_t begin = cut_corners_.size();
        const std::size_t size = facet.end - facet.begin;
        std::ptrdiff_t left = -1;     // the last crossing to the outside
        std::ptrdiff_t entered = -1;  // the first one to the inside, if it was left before
        for (std::size_t i = 0; i < size; ++i) {
            const std::uint32_t a = corners_[facet.begin + i];
            const std::uint32_t b = corners_[facet.begin + (i + 1) % size];
            const bool a_in = sides_[a] == Side::inside;
            const bool b_in = sides_[b] == Side::inside;
            if (a_in) {
                cut_corners_.push_back(a);
            }
            if (a_in == b_in) {
                continue;
            }
            const std::ptrdiff_t c = a_in ? crossing(a, b, facet.cut) : crossing(b, a, facet.cut);
            const std::uint32_t vertex = crossings_[static_cast<std::size_t>(c)].vertex;
            cut_corners_.push_back(vertex);
            if (a_in) {
                left = c;
            } else if (left < 0) {
                entered = c;
            } else {
                // The facet goes on from `left` to here; the new one comes back.
                crossings_[static_cast<std::size_t>(c)].next = static_cast<std::uint32_t>(left);
                left = -1;
            }
        }
        if (entered >= 0) {
            crossings_[static_cast<std::size_t>(entered)].next = static_cast<std::uint32_t>(left);
        }
        if (cut_corners_.size() > begin) {
            cut_facets_.push_back({facet.cut, begin, cut_corners_.size()});
        }
    }
    for (Crossing& first : crossings_) {
        if (first.next == kNone) {
            continue;
        }
        const std::size_t begin = cut_corners_.size();
        for (Crossing* at = &first; at->next != kNone;) {
            cut_corners_.push_back(at->vertex);
            Crossing* const next = &crossings_[at->next];
            at->next = kNone;
            at = next;
        }
        cut_facets_.push_back({by, begin, cut_corners_.size()});
    }
    facets_.swap(cut_facets_);
    corners_.swap(cut_corners_);
}

void CappedTetrahedron::cut_at_iso(const PartVertices& vertices,
                                   const std::array<Corner, 4>& corners, double iso) {
    sides_.clear();
    for (const Corner& corner : corners) {
        const bool solid = (corner.value >= iso) == (outside_ == Outside::below);
        sides_.push_back(solid ? Side::inside : Side::outside);
    }
    cut(kIso, [&](std::uint32_t a, std::uint32_t b) {
        Vertex v;
        v.position =
            vertices
                .on_edge(corners[a].node, corners[a].value, corners[b].node, corners[b].value, iso)
                .position;
        v.nodes = 1U << a | 1U << b;
        v.from = a;
        v.to = b;
        return v;
    });
}

/// A vertex between nodes in the plane and nodes on one side of it is on that side: integers say
/// so. Only between nodes on both sides its place does.
CappedTetrahedron::Side CappedTetrahedron::side_of(const Vertex& v, std::uint32_t plane) const {
    const bool inner = (v.nodes & inner_[plane]) != 0;
    if ((v.nodes & outer_[plane]) == 0) {
        return inner ? Side::inside : Side::on;
    }
    if (!inner) {
        return Side::outside;
    }
    const double x = v.position[plane / 2];
    return ((plane & 1U) == 0 ? x > limit(plane) : x < limit(plane)) ? Side::inside : Side::outside;
}

/// The same bits from all tetrahedra at the edge or face: of an edge of the grid between its nodes,
/// else between the ends of what is left of the polytope's edge, the lower coordinates first.
CappedTetrahedron::Vertex CappedTetrahedron::on_plane(std::uint32_t inside, std::uint32_t outside,
                                                      std::uint32_t plane) const {
    Vertex v;
    v.nodes = vertices_[inside].nodes | vertices_[outside].nodes;
    v.from = inside;
    v.to = outside;
    if (std::popcount(v.nodes) == 2) {
        v.from = static_cast<std::uint32_t>(first_of(v.nodes));
        v.to = static_cast<std::uint32_t>(first_of(v.nodes & (v.nodes - 1)));
    }
    if (vertices_[v.to].position < vertices_[v.from].position) {
        std::swap(v.from, v.to);
    }
    const Double3& p = vertices_[v.from].position;
    const Double3& q = vertices_[v.to].position;
    const std::size_t axis = plane / 2;
    // Where what is just inside was rounded into the plane, both ends may lie there.
    v.t = p[axis] == q[axis] ? 0 : (limit(plane) - p[axis]) / (q[axis] - p[axis]);
    for (std::size_t i = 0; i < 3; ++i) {
        v.position[i] = p[i] + v.t * (q[i] - p[i]);
    }
    v.position[axis] = limit(plane);
    return v;
}

void CappedTetrahedron::cut_at_plane(std::uint32_t plane) {
    sides_.clear();
    for (const Vertex& v : vertices_) {
        sides_.push_back(side_of(v, plane));
    }
    cut(plane, [&](std::uint32_t a, std::uint32_t b) { return on_plane(a, b, plane); });
}

/// In the part's numbers.
std::uint32_t CappedTetrahedron::number_of(PartVertices& vertices,
                                           const std::array<Corner, 4>& corners, double iso,
                                           std::uint32_t v) {
    const std::uint32_t same = vertices_[v].same;
    if (vertices_[same].number != kNone) {
        return vertices_[same].number;
    }
    const Vertex at = vertices_[same];
    const auto corner = [&](std::uint32_t i) -> const Corner& { return corners[i]; };
    const auto between = [&] {
        PartVertices::Between b{0, 0, at.t};
        if (vertices.width() > 0) {
            b.from = number_of(vertices, corners, iso, at.from);
            b.to = number_of(vertices, corners, iso, at.to);
        }
        return b;
    };
    std::uint32_t number = kNone;
    if (const int nodes = std::popcount(at.nodes); nodes == 1) {
        number = vertices.node(corners[first_of(at.nodes)].node);
    } else if (nodes == 2 && at.last == kIso) {
        const Corner& a = corner(at.from);
        const Corner& b = corner(at.to);
        number = vertices.edge(a.node, a.value, b.node, b.value, iso);
    } else if (nodes == 2) {
        number = vertices.edge_cut(corner(at.from).node, corner(at.to).node, 1U << at.last, at.t,
                                   at.position);
    } else if (nodes == 3) {
        const std::size_t opposite = first_of(kAllCorners & ~at.nodes);
        number =
            vertices.face_cut({corners[(opposite + 1) % 4].node, corners[(opposite + 2) % 4].node,
                               corners[(opposite + 3) % 4].node},
                              at.cuts, between(), at.position);
    } else {
        number = vertices.inner_cut(between(), at.position);
    }
    vertices_[same].number = number;
    return number;
}

void CappedTetrahedron::march(PartVertices& vertices, const std::array<Corner, 4>& corners,
                              bool positive, double iso,
                              std::vector<CollectedTriangle>& triangles) {
    assert(std::none_of(corners.begin(), corners.end(), [&](const Corner& c) {
        return is_far_from_faces(vertices.finest(c.node));
    }));
    begin(vertices, corners, positive);
    cut_at_iso(vertices, corners, iso);
    for (std::uint32_t plane = 0; plane < kPlanes && !facets_.empty(); ++plane) {
        // With all corners inside, one or two of them in the plane, nothing is cut off.
        if (outer_[plane] != 0 || std::popcount(inner_[plane]) == 1) {
            cut_at_plane(plane);
        }
    }
    const bool turned = outside_ == Outside::above;
    for (const Facet& facet : facets_) {
        if (facet.cut == kNone) {
            continue;
        }
        polygon_.clear();
        for (std::size_t i = facet.begin; i < facet.end; ++i) {
            const std::uint32_t number = number_of(vertices, corners, iso, corners_[i]);
            if (polygon_.empty() || polygon_.back() != number) {
                polygon_.push_back(number);
            }
        }
        while (polygon_.size() > 1 && polygon_.back() == polygon_.front()) {
            polygon_.pop_back();
        }
        for (std::size_t i = 2; i < polygon_.size(); ++i) {
            const std::uint32_t a = polygon_[0];
            const std::uint32_t b = polygon_[turned ? i : i - 1];
            const std::uint32_t c = polygon_[turned ? i - 1 : i];
            if (a != b && b != c && c != a) {
                triangles.push_back({{a, b, c}, false});
            }
        }
    }
}

}  // namespace isonest::detail
