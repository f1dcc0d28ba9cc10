#include "query/march/capped_hexahedron.h"

#include <algorithm>
#include <cmath>

#include "query/march/finest_crossing.h"
#include "query/march/hexahedron_cases.h"
#include "query/march/triangulate_polygon.h"
#include "query/view/topology.h"

namespace isonest::detail {
namespace {

/// a + t (b - a), within both, and both themselves at the ends.
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

/// The same bits from all cells at a corner: of a value only the nodes of the edge or face count in
/// which the corner lies.
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

/// As VertexKey::planes; those that cut the cell alone.
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

/// Twice the midpoint of the node, edge, face or cell in which the corner lies.
Int3 CappedHexahedron::twice(unsigned corner) const {
    Int3 sum = cell_.low * 2;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned high = corner >> axis & 1U;
        sum[static_cast<int>(axis)] += end(corner, axis).cut ? 1 : 2 * high;
    }
    return sum;
}

/// Mixed along one axis after the other, as the values are.
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
    // The lower end is the first one, as it is in an edge that is not cut.
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

/// A convex polygon, counterclockwise seen from outside.
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

/// Each run of corners below, on the way around a face, is cut off by a side: what is below is a
/// polygon for each, what is not below is one.
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
    // From the first corner of a run on, around the face.
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
