#include "query/tiles/tile_mesh.h"

#include <tsl/robin_map.h>
#include <tsl/robin_set.h>

#include <tuple>

#include "store/base/box.h"

namespace isonest::detail {

TileGrid TileGrid::over(const Double3& spacing, const Double3& first, const Double3& last,
                        double most) {
    const double finest = *std::min_element(spacing.begin(), spacing.end());
    double longest = 0;  // in finest steps
    for (std::size_t axis = 0; axis < 3; ++axis) {
        longest = std::max(longest, (std::ceil(last[axis]) - std::floor(first[axis]) + 2) *
                                        spacing[axis] / finest);
    }
    TileGrid grid;
    constexpr double kLarger = 1.41421356;  // cubes may be larger or smaller by this factor
    while (grid.top < kMaxTop && std::ldexp(most * kLarger, grid.top) < longest) {
        ++grid.top;
    }
    const double edge = std::ldexp(longest, -grid.top) * finest;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Even, so that cubes can be divided at nodes.
        const double nodes = 2 * std::ceil(edge / spacing[axis] / 2);
        grid.edge[axis] = nodes * spacing[axis];
        const double inside = std::ceil(last[axis]) - std::floor(first[axis]);
        const double margin = std::floor((std::ldexp(nodes, grid.top) - inside) / 2);
        // The same on both sides of a small box; cubes beyond a larger one stay empty.
        grid.origin[axis] =
            (std::floor(first[axis]) - std::clamp(margin, 1.0, nodes / 2)) * spacing[axis];
    }
    return grid;
}

TileGrid TileGrid::finer() const {
    TileGrid grid = *this;
    for (double& e : grid.edge) {
        e /= 2;
    }
    ++grid.top;
    return grid;
}

Double3 TileGrid::low_of(std::uint32_t number, int level) const {
    const auto cube = cube_at(number);
    Double3 low{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = std::ldexp(cube.at(axis) * edge[axis], level);
    }
    return low;
}

std::array<std::int64_t, 3> TileGrid::rounded(const Double3& cubes) const {
    std::array<std::int64_t, 3> at{};
    const auto round_to = [&](int level) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double steps = std::ldexp(cubes[axis] * kTileSteps, -level);
            at[axis] = static_cast<std::int64_t>(std::round(steps)) << level;
        }
    };
    // The highest level of cubes with a face here; -1: there is none.
    const auto level_of = [&](std::int64_t steps) {
        if (steps % kTileSteps != 0) {
            return -1;
        }
        const auto plane = static_cast<std::uint64_t>(steps / kTileSteps);
        return plane == 0 ? top : std::min(std::countr_zero(plane), top);
    };
    round_to(0);
    for (int level = 0;;) {
        const int needed = std::max({level_of(at[0]), level_of(at[1]), level_of(at[2])});
        if (needed <= level) {
            return at;
        }
        level = needed;
        round_to(level);
    }
}

std::uint32_t cube_number(const std::array<std::uint32_t, 3>& cube) {
    std::uint32_t number = 0;
    for (unsigned bit = 0; bit < 10; ++bit) {
        for (unsigned axis = 0; axis < 3; ++axis) {
            number |= (cube.at(axis) >> bit & 1U) << (3 * bit + axis);
        }
    }
    return number;
}

std::array<std::uint32_t, 3> cube_at(std::uint32_t number) {
    std::array<std::uint32_t, 3> cube{};
    for (unsigned bit = 0; bit < 10; ++bit) {
        for (unsigned axis = 0; axis < 3; ++axis) {
            cube.at(axis) |= (number >> (3 * bit + axis) & 1U) << bit;
        }
    }
    return cube;
}

namespace {

/// Coordinates from 0 to 2 kTileSteps need 17 bits.
constexpr unsigned kPlaceBits = 17;

std::uint64_t key_of(const Steps& at) {
    return static_cast<std::uint64_t>(at[2]) << 2 * kPlaceBits |
           static_cast<std::uint64_t>(at[1]) << kPlaceBits | static_cast<std::uint64_t>(at[0]);
}

/// Everything in a triangle.
auto sort_key(const TileTriangle& t) {
    const auto corner = [](const TileCorner& c) {
        return std::tuple(key_of({c.at[0], c.at[1], c.at[2]}), c.normal, c.value);
    };
    return std::tuple(t.feature, corner(t.corners[0]), corner(t.corners[1]), corner(t.corners[2]));
}

}  // namespace

TileMesh tile_mesh(std::span<const TileTriangle> triangles) {
    std::vector<TileTriangle> sorted(triangles.begin(), triangles.end());
    std::sort(sorted.begin(), sorted.end(), [](const TileTriangle& a, const TileTriangle& b) {
        return sort_key(a) < sort_key(b);
    });
    TileMesh mesh;
    tsl::robin_map<std::uint64_t, std::uint32_t, MixedHash> numbers;  // of one feature
    std::uint32_t feature = 0;
    for (const TileTriangle& triangle : sorted) {
        if (triangle.feature != feature) {
            numbers.clear();
            feature = triangle.feature;
        }
        PatchTriangle t{};
        for (std::size_t k = 0; k < 3; ++k) {
            const TileCorner& corner = triangle.corners[k];
            const Steps at{corner.at[0], corner.at[1], corner.at[2]};
            const auto [slot, is_new] =
                numbers.try_emplace(key_of(at), static_cast<std::uint32_t>(mesh.vertices.size()));
            t[k] = slot->second;
            if (is_new) {
                mesh.vertices.push_back({at, corner.normal, corner.value, feature});
            }
        }
        mesh.triangles.push_back(t);
    }
    return mesh;
}

namespace {

/// An edge between two places, without a direction.
struct PlacePair {
    std::uint64_t low = 0;
    std::uint64_t high = 0;

    PlacePair(const Steps& a, const Steps& b)
        : low(std::min(key_of(a), key_of(b))), high(std::max(key_of(a), key_of(b))) {}
    bool operator==(const PlacePair&) const = default;
};

struct PairHash {
    std::size_t operator()(const PlacePair& pair) const {
        const MixedHash mixed;
        return mixed(pair.low ^ mixed(pair.high));
    }
};

/// A place one step from `at` along an axis, within the tile.
Steps beside(const Steps& at, std::size_t axis) {
    Steps to = at;
    to[axis] += at[axis] < kTileSteps ? 1 : -1;
    return to;
}

}  // namespace

bool widen_lines(TileMesh& mesh) {
    std::vector<PatchTriangle> kept;
    std::vector<PatchTriangle> lines;
    for (const PatchTriangle& t : mesh.triangles) {
        (mesh.has_places(t) ? kept : lines).push_back(t);
    }
    if (lines.empty()) {
        return false;
    }
    tsl::robin_set<PlacePair, PairHash> edges;
    const auto at = [&](std::uint32_t v) { return mesh.vertices[v].at; };
    const auto add_edges = [&](const PatchTriangle& t) {
        for (std::size_t k = 0; k < 3; ++k) {
            edges.insert(PlacePair(at(t[k]), at(t[(k + 1) % 3])));
            edges.insert(PlacePair(at(t[k]), at(t[k])));
        }
    };
    for (const PatchTriangle& t : kept) {
        add_edges(t);
    }
    bool widened = false;
    for (const PatchTriangle& t : lines) {
        const std::uint32_t a = t[0];
        const std::uint32_t c = at(t[1]) != at(a) ? t[1] : t[2];
        if (edges.contains(PlacePair(at(a), at(c)))) {
            continue;
        }
        widened = true;
        const auto add_vertex = [&](const Steps& place) {
            TileMesh::Vertex v = mesh.vertices[c];
            v.at = place;
            mesh.vertices.push_back(v);
            return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
        };
        // Along the axis in which the line is shortest, so that the triangle has an area.
        std::size_t axis = 0;
        for (std::size_t k = 1; k < 3; ++k) {
            axis = std::abs(at(c)[k] - at(a)[k]) < std::abs(at(c)[axis] - at(a)[axis]) ? k : axis;
        }
        const std::uint32_t second =
            at(a) == at(c) ? add_vertex(beside(at(a), axis == 0 ? 1 : 0)) : c;
        kept.push_back({a, second, add_vertex(beside(at(second), axis))});
        add_edges(kept.back());
        edges.insert(PlacePair(at(a), at(c)));
    }
    mesh.triangles = std::move(kept);
    return widened;
}

std::vector<TileTriangle> triangles_of(const TileMesh& mesh, std::uint32_t block) {
    std::vector<TileTriangle> triangles;
    triangles.reserve(mesh.triangles.size());
    for (const PatchTriangle& t : mesh.triangles) {
        TileTriangle triangle{block, mesh.vertices[t[0]].feature, {}};
        for (std::size_t k = 0; k < 3; ++k) {
            const TileMesh::Vertex& v = mesh.vertices[t[k]];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                triangle.corners[k].at[axis] = static_cast<std::uint16_t>(v.at[axis]);
            }
            triangle.corners[k].normal = v.normal;
            triangle.corners[k].value = v.value;
        }
        triangles.push_back(triangle);
    }
    return triangles;
}

}  // namespace isonest::detail
