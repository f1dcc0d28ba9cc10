#include "query/march/capped_cells.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>

#include "query/march/cube_cases.h"
#include "query/march/march_hexahedron.h"
#include "query/march/vertex_attributes.h"
#include "query/values/topology.h"

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

/// Keeps the inside. sides_ defines what is inside; make(inside, outside) returns the vertex where
/// an edge crosses `by`.
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
                made = vertices_[out];  // keeps its `same`
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
        std::ptrdiff_t left = -1;  // the last crossing to the outside
        // the first crossing to the inside, if the polygon starts outside
        std::ptrdiff_t entered = -1;
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
                // The facet continues from `left` to here; the new facet runs back.
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

/// A vertex between nodes in the plane and nodes on one side of it is on that side, decided by
/// integers. Only between nodes on both sides its position decides.
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

/// Bit for bit the same from all tetrahedra at the edge or face: on an edge of the grid,
/// interpolated between its nodes; otherwise between the ends of the remaining part of the
/// polytope's edge, lower coordinates first.
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
    // If a point just inside was rounded into the plane, both ends may be in it.
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

/// The vertex's number in the part.
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
        // If all corners are inside, with one or two of them in the plane, nothing is cut off.
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

namespace {

/// a + t (b - a), limited to the range of both; exactly a or b at the ends.
double value_between(double a, double b, double t) {
    if (t == 0 || t == 1) {
        return t == 0 ? a : b;
    }
    const double d = b - a;
    const double value = std::isfinite(d) ? a + t * d : (1 - t) * a + t * b;
    return std::clamp(value, std::min(a, b), std::max(a, b));
}

}  // namespace

unsigned CappedHexahedron::corners_far_from_faces(const Cube& cube) const {
    unsigned far = 0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        const Double3 p = as_point(cube.low + corner_offset(corner));
        bool is_far = true;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            is_far = is_far && p[axis] - 1 > box_.lo[axis] && p[axis] + 1 < box_.hi[axis];
        }
        far |= (is_far ? 1U : 0U) << corner;
    }
    return far;
}

/// Bit for bit the same from all cells at a corner: its value depends only on the nodes of the edge
/// or face that contains it.
void CappedHexahedron::cut_cell(const Cube& cube) {
    for (unsigned axis = 0; axis < 3; ++axis) {
        const auto low = static_cast<double>(cube.low[static_cast<int>(axis)]);
        const double box_low = box_.lo[axis];
        const double box_high = box_.hi[axis];
        ends_[axis][0] = box_low > low ? End{box_low, box_low - low, true, true}
                                       : End{low, 0, false, box_low == low};
        ends_[axis][1] = box_high < low + 1 ? End{box_high, box_high - low, true, true}
                                            : End{low + 1, 1, false, box_high == low + 1};
    }
    cell_ = cube;
    for (unsigned axis = 0; axis < 3; ++axis) {
        std::array<double, 8> value{};
        for (unsigned corner = 0; corner < 8; ++corner) {
            const unsigned bit = 1U << axis;
            value[corner] = value_between(cell_.value[corner & ~bit], cell_.value[corner | bit],
                                          end(corner, axis).t);
        }
        cell_.value = value;
    }
}

/// As VertexKey::planes; only planes that cut the cell.
unsigned CappedHexahedron::planes_at(unsigned corner) const {
    unsigned planes = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        planes |= end(corner, axis).cut ? 1U << (2 * axis + (corner >> axis & 1U)) : 0U;
    }
    return planes;
}

Double3 CappedHexahedron::position_of(unsigned corner) const {
    return {end(corner, 0).at, end(corner, 1).at, end(corner, 2).at};
}

/// Twice the midpoint of the node, edge, face or cell that contains the corner.
Int3 CappedHexahedron::twice(unsigned corner) const {
    Int3 sum = cell_.low * 2;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned high = corner >> axis & 1U;
        sum[static_cast<int>(axis)] += end(corner, axis).cut ? 1 : 2 * high;
    }
    return sum;
}

/// Interpolated along one axis after another, like the values.
VertexAttributes CappedHexahedron::attributes_of(AttributeSampler& sampler, unsigned corner) const {
    const auto cut = [&](unsigned axis) { return end(corner, axis).cut; };
    const unsigned first = cut(0) ? 0 : cut(1) ? 1 : 2;
    const auto on_line = [&](unsigned at) {
        const Int3 low = cell_.low + corner_offset(at & ~(1U << first));
        return cut(first) ? sampler.edge(low, cell_.low + corner_offset(at | 1U << first),
                                         end(corner, first).t)
                          : sampler.node(cell_.low + corner_offset(at));
    };
    const auto in_square = [&](unsigned at) {
        return first == 0 && cut(1)
                   ? sampler.mix(on_line(at & ~2U), on_line(at | 2U), end(corner, 1).t)
                   : on_line(at);
    };
    return first < 2 && cut(2)
               ? sampler.mix(in_square(corner & ~4U), in_square(corner | 4U), end(corner, 2).t)
               : in_square(corner);
}

std::uint32_t CappedHexahedron::corner_vertex(PartVertices& vertices, unsigned corner) const {
    const unsigned planes = planes_at(corner);
    if (planes == 0) {
        return vertices.node(cell_.low + corner_offset(corner));
    }
    return vertices.cell_cut(twice(corner), planes, position_of(corner),
                             [&](AttributeSampler& sampler) {
                                 return sampler.with_unit_normal(attributes_of(sampler, corner));
                             });
}

std::uint32_t CappedHexahedron::edge_vertex(PartVertices& vertices, std::size_t edge,
                                            double iso) const {
    const CubeEdge& e = kCubeEdge[edge];
    const unsigned low_planes = planes_at(e.low);
    const unsigned high_planes = planes_at(e.high);
    if ((low_planes | high_planes) == 0) {
        return vertices.edge_of_cube(cell_, edge, iso);
    }
    // The lower end is the first one, as on an edge that is not cut.
    const double t = crossing_of(cell_.value[e.low], cell_.value[e.high], iso);
    const Double3 from = position_of(e.low);
    const Double3 to = position_of(e.high);
    Double3 position{};
    Int3 middle = twice(e.low);
    for (unsigned axis = 0; axis < 3; ++axis) {
        position[axis] = from[axis] + t * (to[axis] - from[axis]);
        if (((e.low ^ e.high) >> axis & 1U) != 0) {
            const auto a = static_cast<int>(axis);
            middle[a] = 2 * cell_.low[a] + 1;
        }
    }
    return vertices.cell_cut(
        middle, low_planes & high_planes, position, [&](AttributeSampler& sampler) {
            return sampler.with_unit_normal(
                sampler.mix(attributes_of(sampler, e.low), attributes_of(sampler, e.high), t));
        });
}

/// Adds a convex polygon, counterclockwise seen from outside.
void CappedHexahedron::add_cap(const PartVertices& vertices,
                               std::vector<CollectedTriangle>& triangles) const {
    const auto cost = [&](std::size_t i, std::size_t j) {
        const Double3& p = vertices.position(polygon_[i]);
        const Double3& q = vertices.position(polygon_[j]);
        double sum = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            sum += (p[axis] - q[axis]) * (p[axis] - q[axis]);
        }
        return sum;
    };
    const bool turned = outside_ == Outside::above;
    triangulate_polygon(size_, cost, [&](std::size_t i, std::size_t j, std::size_t k) {
        triangles.push_back(
            {{polygon_[i], polygon_[turned ? k : j], polygon_[turned ? j : k]}, false});
    });
}

/// Going around a face, each run of corners below is cut off by a side: each run below is one
/// polygon, everything not below is one polygon.
void CappedHexahedron::add_caps(PartVertices& vertices, unsigned face, double iso,
                                std::vector<CollectedTriangle>& triangles) {
    const std::array<unsigned, 4> corner = corners_of_face(face);
    const bool solid_below = outside_ == Outside::above;
    const auto is_solid = [&](std::size_t i) {
        return ((cell_.below >> corner[i % 4] & 1U) != 0) == solid_below;
    };
    std::size_t first = 0;
    while (first < 4 && !(is_solid(first) && !is_solid(first + 3))) {
        ++first;
    }
    if (first == 4 && !is_solid(0)) {
        return;
    }
    size_ = 0;
    // Goes around the face, starting with the first corner of a run.
    for (std::size_t i = first; i < first + 4; ++i) {
        const bool begins = !is_solid(i + 3);
        if (is_solid(i)) {
            if (begins) {
                polygon_[size_++] =
                    edge_vertex(vertices, edge_between(corner[(i + 3) % 4], corner[i % 4]), iso);
            }
            polygon_[size_++] = corner_vertex(vertices, corner[i % 4]);
        } else if (!begins) {
            polygon_[size_++] =
                edge_vertex(vertices, edge_between(corner[(i + 3) % 4], corner[i % 4]), iso);
            if (solid_below) {
                add_cap(vertices, triangles);
                size_ = 0;
            }
        }
    }
    if (size_ > 0) {
        add_cap(vertices, triangles);
    }
}

bool CappedHexahedron::march(PartVertices& vertices, const Cube& cube, double iso,
                             std::vector<CollectedTriangle>& triangles) {
    cut_cell(cube);
    cell_.below = 0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        cell_.below |= (cell_.value[corner] < iso ? 1U : 0U) << corner;
    }
    const std::size_t before = triangles.size();
    const HexahedronCase& c = hexahedron_cases()[cell_.below];
    std::array<std::uint32_t, 12> v{};
    for (std::size_t i = 0; i < c.edges; ++i) {
        v[i] = edge_vertex(vertices, c.edge[i], iso);
    }
    for (std::size_t i = 0; i < c.triangles; ++i) {
        const auto& t = c.triangle[i];
        triangles.push_back({{v[t[0]], v[t[1]], v[t[2]]}, false});
    }
    for (unsigned face = 0; face < 6; ++face) {
        if (ends_[face / 2][face & 1U].face) {
            add_caps(vertices, face, iso, triangles);
        }
    }
    return triangles.size() > before;
}

}  // namespace isonest::detail
