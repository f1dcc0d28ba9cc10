#include "query/neuroglancer/cut_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

/// `c`: in strips, relative to the cell's start.
std::uint16_t rounded_in_cell(double c, int strips) {
    constexpr double kMax = kMaxInCell;
    return static_cast<std::uint16_t>(std::clamp(std::round(c / strips * kMax), 0.0, kMax));
}

}  // namespace

void CutMesh::begin(const MeshLayout& layout) {
    Int3 cells{1, 1, 1};
    if (layout.vertices > 0) {
        Double3 most{};
        for (unsigned corner = 0; corner < 8; ++corner) {
            std::array<float, 3> p = layout.lo;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                p[axis] = (corner >> axis & 1U) != 0 ? layout.hi[axis] : p[axis];
            }
            const Double3 strips = grid_.strips_of(p);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                most[axis] = std::max(most[axis], strips[axis]);
            }
        }
        for (int axis = 0; axis < 3; ++axis) {
            const auto strip = static_cast<std::int64_t>(most[static_cast<std::size_t>(axis)]);
            cells[axis] = strip / grid_.strips() + 1;
        }
    }
    order_ = ZOrderedCells(cells);
    if (order_.bits() > ZOrderedCells::kMaxBits) {
        throw Error(ErrorKind::limit, fmt::format("a mesh of {} x {} x {} cells is too large for "
                                                  "Neuroglancer's format as isonest writes it",
                                                  cells.x, cells.y, cells.z));
    }
}

void CutMesh::add_elements(const ElementBatch& batch) {
    for (const auto& t : batch.nearby_corners) {
        const auto& p = batch.nearby.positions;
        const CutPolygon<Double3> whole(grid_.strips_of(p[t[0]]), grid_.strips_of(p[t[1]]),
                                        grid_.strips_of(p[t[2]]));
        cut_at_planes(whole, 0, {}, [&](const Int3& strip, const CutPolygon<Double3>& part) {
            add(strip, part);
        });
    }
}

void CutMesh::add(const Int3& strip, const CutPolygon<Double3>& polygon) {
    const int strips = grid_.strips();
    Int3 cell;
    for (int axis = 0; axis < 3; ++axis) {
        cell[axis] = strip[axis] / strips;
    }
    std::array<CellPoint, CutPolygon<Double3>::kMax> points{};
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto from = static_cast<double>(cell[static_cast<int>(axis)] * strips);
            points[i][axis] = rounded_in_cell(polygon[i][axis] - from, strips);
        }
    }
    CellTriangle triangle;
    triangle.block = static_cast<std::uint32_t>(order_.number_of(cell));
    for (std::size_t i = 2; i < polygon.size(); ++i) {
        triangle.corners = {points[0], points[i - 1], points[i]};
        const auto& [a, b, c] = triangle.corners;
        if (a != b && b != c && c != a) {
            triangles_.append(triangle);
        }
    }
}

void CutMesh::end() {
    triangles_.sort(cells());
}

std::uint64_t CutMesh::largest() const {
    std::uint64_t most = 0;
    for (std::uint32_t i = 0; i < cells(); ++i) {
        most = std::max<std::uint64_t>(most, of(i).size());
    }
    return most;
}

}  // namespace isonest::detail
