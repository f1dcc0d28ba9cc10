// Shared by the tests of simplification: surfaces, samples of them, and their topology, counted
// independently of the tested code.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/patch.h"
#include "query/simplify/proof/surface_distance.h"

namespace isonest::detail::test {

template <class Visit>
void for_samples(const Triangle& t, int steps, const Visit& visit) {
    for (int i = 0; i <= steps; ++i) {
        for (int j = 0; i + j <= steps; ++j) {
            const double a = static_cast<double>(i) / steps;
            const double b = static_cast<double>(j) / steps;
            visit(along(along(t[0], a, minus(t[1], t[0])), b, minus(t[2], t[0])));
        }
    }
}

inline void finish(Patch& patch) {
    patch.shared.assign(patch.positions.size(), false);
    patch.stay.assign(patch.triangles.size(), Stay::no);
    patch.tried.assign(patch.triangles.size(), false);
    patch.displacements.assign(patch.triangles.size(), {});
    patch.fine = patch.triangles;
    patch.witnesses.resize(patch.fine.size());
    std::iota(patch.witnesses.begin(), patch.witnesses.end(), 0U);
}

/// n x n nodes, with heights up to `height`.
inline Patch wavy_grid(std::uint32_t n, double height) {
    Patch patch;
    for (std::uint32_t y = 0; y < n; ++y) {
        for (std::uint32_t x = 0; x < n; ++x) {
            const double z = height * std::sin(0.7 * x) * std::cos(0.9 * y + 0.1 * x);
            patch.positions.push_back(
                {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
        }
    }
    for (std::uint32_t y = 0; y + 1 < n; ++y) {
        for (std::uint32_t x = 0; x + 1 < n; ++x) {
            const std::uint32_t v = y * n + x;
            patch.triangles.push_back({v, v + 1, v + n});
            patch.triangles.push_back({v + 1, v + n + 1, v + n});
        }
    }
    finish(patch);
    return patch;
}

/// A torus around the z axis of n x m quadrilaterals, with noise up to `noise`.
inline Patch torus(std::uint32_t n, std::uint32_t m, double large, double small, double noise) {
    Patch patch;
    constexpr double kTurn = 6.283185307179586;
    for (std::uint32_t i = 0; i < n; ++i) {
        for (std::uint32_t j = 0; j < m; ++j) {
            const double u = kTurn * i / n;
            const double v = kTurn * j / m;
            const double r = small + noise * std::sin(13.0 * i + 7.0 * j * j);
            const double out = large + r * std::cos(v);
            patch.positions.push_back({static_cast<float>(out * std::cos(u)),
                                       static_cast<float>(out * std::sin(u)),
                                       static_cast<float>(r * std::sin(v))});
        }
    }
    const auto at = [&](std::uint32_t i, std::uint32_t j) { return i % n * m + j % m; };
    for (std::uint32_t i = 0; i < n; ++i) {
        for (std::uint32_t j = 0; j < m; ++j) {
            patch.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
            patch.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    }
    finish(patch);
    return patch;
}

/// Appends `other`, moved by `move`.
inline void append(Patch& patch, const Patch& other, const std::array<float, 3>& move) {
    const auto first = static_cast<std::uint32_t>(patch.positions.size());
    for (const auto& p : other.positions) {
        patch.positions.push_back({p[0] + move[0], p[1] + move[1], p[2] + move[2]});
    }
    for (const PatchTriangle& t : other.triangles) {
        patch.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
    }
    finish(patch);
}

inline void fill(ScratchMesh& mesh, const Patch& patch) {
    MeshLayout layout;
    layout.vertices = patch.positions.size();
    layout.elements = patch.triangles.size();
    mesh.begin(layout);
    VertexBatch vertices;
    vertices.positions = patch.positions;
    mesh.add_vertices(vertices);
    std::vector<ElementCorners> corners;
    for (const PatchTriangle& t : patch.triangles) {
        corners.push_back({t[0], t[1], t[2]});
    }
    ElementBatch batch;
    batch.corners = corners;
    mesh.add_elements(batch);
    mesh.end();
}

struct Shape {
    int components = 0;
    int euler = 0;
    int border_loops = 0;
    int bad_edges = 0;  ///< with more than two triangles, or two of inconsistent orientation
    int repeated = 0;
    bool operator==(const Shape&) const = default;
};

template <class Corners>
Shape shape_of(const std::vector<Corners>& triangles) {
    using Vertex = std::uint64_t;
    std::map<std::pair<Vertex, Vertex>, int> edges;  // directed
    std::map<Vertex, Vertex> parent;
    std::map<Vertex, Vertex> border;
    std::set<std::array<Vertex, 3>> seen;
    const auto root = [](std::map<Vertex, Vertex>& of, Vertex v) {
        of.emplace(v, v);
        while (of[v] != v) {
            v = of[v] = of[of[v]];
        }
        return v;
    };
    const auto roots = [](const std::map<Vertex, Vertex>& of) {
        return static_cast<int>(
            std::count_if(of.begin(), of.end(), [](const auto& e) { return e.first == e.second; }));
    };
    Shape shape;
    for (const Corners& t : triangles) {
        std::array<Vertex, 3> sorted{t[0], t[1], t[2]};
        for (std::size_t i = 0; i < 3; ++i) {
            ++edges[{t[i], t[(i + 1) % 3]}];
            parent[root(parent, t[i])] = root(parent, t[(i + 1) % 3]);
        }
        std::sort(sorted.begin(), sorted.end());
        shape.repeated += seen.insert(sorted).second ? 0 : 1;
    }
    int both = 0;
    for (const auto& [edge, count] : edges) {
        const bool twin = edges.contains({edge.second, edge.first});
        shape.bad_edges += count > 1 ? 1 : 0;
        both += twin ? 1 : 0;
        if (!twin) {
            border[root(border, edge.first)] = root(border, edge.second);
        }
    }
    shape.components = roots(parent);
    shape.border_loops = roots(border);
    shape.euler = static_cast<int>(parent.size()) - (static_cast<int>(edges.size()) - both / 2) +
                  static_cast<int>(triangles.size());
    return shape;
}

/// The maximum distance of a sample of `from` from `to`.
template <class Corners>
double sampled_distance(const std::vector<std::array<float, 3>>& positions,
                        const std::vector<Corners>& from, const std::vector<Corners>& to,
                        int steps) {
    const auto narrow = [](const std::vector<Corners>& triangles) {
        std::vector<TriangleTree::Corners> out;
        for (const Corners& t : triangles) {
            out.push_back({static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]),
                           static_cast<std::uint32_t>(t[2])});
        }
        return out;
    };
    const TriangleTree a(positions, narrow(from));
    const TriangleTree b(positions, narrow(to));
    double worst = 0;
    for (std::uint32_t t = 0; t < a.size(); ++t) {
        for_samples(a.triangle(t), steps, [&](const Double3& p) {
            worst = std::max(worst, b.nearest(p, 1e300).square_distance);
        });
    }
    return std::sqrt(worst);
}

}  // namespace isonest::detail::test
