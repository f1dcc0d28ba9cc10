// Meshes after many collapses: within the distance, by samples in both directions, and with the
// same topology, counted independently.
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "query/simplify/collapse/map_mesh.h"
#include "store/base/workers.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Before any collapse.
MappedPatch mapped(const Patch& patch) {
    MappedPatch m;
    m.positions = patch.positions;
    m.box = patch.box;
    m.shared = patch.shared;
    m.triangles = patch.triangles;
    m.displacements.resize(m.triangles.size());
    m.tried.resize(m.triangles.size());
    return m;
}

CollapseLimits limits_of(double distance) {
    return {distance, static_cast<float>(4 * distance * distance)};
}

/// Angles in degrees between the normals at each edge of two triangles.
template <class Corners>
std::vector<double> folds_of(const std::vector<std::array<float, 3>>& positions,
                             const std::vector<Corners>& triangles) {
    const auto point = [&](std::uint64_t v) { return point_at(positions[v]); };
    std::map<std::pair<std::uint64_t, std::uint64_t>, Double3> normals;
    for (const Corners& t : triangles) {
        const Double3 n = cross(minus(point(t[1]), point(t[0])), minus(point(t[2]), point(t[0])));
        for (std::size_t i = 0; i < 3; ++i) {
            normals[{t[i], t[(i + 1) % 3]}] = n;
        }
    }
    std::vector<double> folds;
    for (const auto& [edge, n] : normals) {
        const auto other = normals.find({edge.second, edge.first});
        if (edge.first < edge.second && other != normals.end()) {
            constexpr double kDegrees = 57.29577951308232;
            folds.push_back(kDegrees *
                            std::atan2(length(cross(n, other->second)), dot(n, other->second)));
        }
    }
    return folds;
}

template <class Corners>
void require_no_new_folds(const std::vector<std::array<float, 3>>& positions,
                          const std::vector<Corners>& full, const std::vector<Corners>& left) {
    const auto count = [](const std::vector<double>& folds) {
        return std::count_if(folds.begin(), folds.end(), [](double x) { return x > 72.01; });
    };
    const std::vector<double> before = folds_of(positions, full);
    const std::vector<double> after = folds_of(positions, left);
    REQUIRE(count(after) <= count(before));
    const double most = before.empty() ? 0 : *std::max_element(before.begin(), before.end());
    for (const double fold : after) {
        REQUIRE(fold <= std::max(72.01, most + 0.01));
    }
}

/// The minimum over the triangles of the height divided by the longest side.
double thinnest(const Patch& patch, const std::vector<PatchTriangle>& triangles) {
    double least = 1;
    for (const PatchTriangle& t : triangles) {
        const Triangle p = patch.at(t);
        const double area = length(cross(minus(p[1], p[0]), minus(p[2], p[0])));
        double longest = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            longest = std::max(longest, square(minus(p[(i + 1) % 3], p[i])));
        }
        least = std::min(least, longest > 0 ? area / longest : 0);
    }
    return least;
}

/// Maps the patch and checks the result.
MappedPatch require_within(const Patch& patch, double limit) {
    MappedPatch m = mapped(patch);
    map_patch(m, limits_of(limit));
    REQUIRE(m.displacements.size() == m.triangles.size());
    REQUIRE(m.tried.size() == m.triangles.size());
    REQUIRE(shape_of(m.triangles) == shape_of(patch.triangles));
    constexpr int kSteps = 6;
    double most = 0;
    for (std::size_t i = 0; i < m.triangles.size(); ++i) {
        const double bound = m.displacements[i].bound();
        REQUIRE(bound <= limit);
        most = std::max(most, bound);
    }
    REQUIRE(sampled_distance(patch.positions, patch.triangles, m.triangles, kSteps) <=
            most * (1 + 1e-9) + 1e-9);
    const TriangleTree full(patch.positions, patch.triangles);
    for (std::size_t i = 0; i < m.triangles.size(); ++i) {
        const double bound = m.displacements[i].bound() * (1 + 1e-9) + 1e-9;
        for_samples(patch.at(m.triangles[i]), kSteps, [&](const Double3& p) {
            REQUIRE(full.nearest(p, 1e300).square_distance <= bound * bound);
        });
    }
    require_no_new_folds(patch.positions, patch.triangles, m.triangles);
    REQUIRE(thinnest(patch, m.triangles) >=
            std::min(0.0869, thinnest(patch, patch.triangles) * (1 - 1e-5)));
    return m;
}

Patch back_to_front(Patch patch) {
    for (PatchTriangle& t : patch.triangles) {
        std::swap(t[1], t[2]);
    }
    finish(patch);
    return patch;
}

/// A grid whose inner nodes are moved at random, so that its triangles have various shapes.
Patch rough_grid(std::mt19937& random, std::uint32_t n, double height) {
    Patch patch = wavy_grid(n, 0);
    std::uniform_real_distribution<float> number(-1, 1);
    for (std::uint32_t v = 0; v < patch.positions.size(); ++v) {
        auto& p = patch.positions[v];
        const bool inside = v % n != 0 && v % n != n - 1 && v >= n && v < n * (n - 1);
        p[0] += inside ? 0.4F * number(random) : 0;
        p[1] += inside ? 0.4F * number(random) : 0;
        p[2] = static_cast<float>(height) * number(random);
    }
    return patch;
}

template <class Corners>
std::size_t border_edges(const std::vector<Corners>& triangles) {
    std::set<std::pair<std::uint64_t, std::uint64_t>> edges;
    for (const Corners& t : triangles) {
        for (std::size_t i = 0; i < 3; ++i) {
            edges.insert({t[i], t[(i + 1) % 3]});
        }
    }
    return static_cast<std::size_t>(std::count_if(edges.begin(), edges.end(), [&](const auto& e) {
        return !edges.contains({e.second, e.first});
    }));
}

}  // namespace

TEST_CASE(
    "A mapped mesh is within the distance in both directions, each triangle within its own bound, "
    "and the topology is preserved") {
    std::mt19937 random(14);
    for (const double limit : {0.05, 0.3, 1.5, 30.0}) {
        require_within(wavy_grid(25, 0.4), limit);
        require_within(torus(40, 16, 5, 1.5, 0.2), limit);
        require_within(rough_grid(random, 25, 0.3), limit);
        require_within(rough_grid(random, 20, 2), limit);
        // A thin sheet with two sides, and other surfaces near it.
        Patch sheet = wavy_grid(20, 0.3);
        append(sheet, back_to_front(wavy_grid(20, 0.3)), {0, 0, 0.05F});
        append(sheet, torus(24, 10, 3, 0.8, 0.1), {10, 10, 0.5F});
        require_within(sheet, limit);
    }
    const MappedPatch flat = require_within(wavy_grid(30, 0), 1e-3);
    REQUIRE(flat.triangles.size() < 300);
    const MappedPatch smooth = require_within(torus(160, 64, 20, 6, 0), 0.2);
    REQUIRE(smooth.triangles.size() < 160 * 64 * 2 / 8);
}

TEST_CASE("Borders in faces of the box are simplified there, others are kept") {
    for (const double height : {0.0, 0.4}) {
        Patch patch = wavy_grid(24, height);
        const MappedPatch free = require_within(patch, 0.5);
        REQUIRE(border_edges(free.triangles) == border_edges(patch.triangles));
        patch.box.lo = {0, 0, -9};
        patch.box.hi = {23, 23, 9};
        const MappedPatch cut = require_within(patch, 0.5);
        REQUIRE(border_edges(cut.triangles) < border_edges(patch.triangles) / 2);
        // The corners of the box stay, so that the border stays in its faces.
        std::set<std::uint32_t> used;
        for (const PatchTriangle& t : cut.triangles) {
            used.insert(t.begin(), t.end());
        }
        for (const std::uint32_t corner : {0U, 23U, 23U * 24U, 24U * 24U - 1}) {
            REQUIRE(used.contains(corner));
        }
        std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
        for (const PatchTriangle& t : cut.triangles) {
            for (std::size_t i = 0; i < 3; ++i) {
                ++edges[std::minmax(t[i], t[(i + 1) % 3])];
            }
        }
        for (const auto& [edge, count] : edges) {
            const auto& p = cut.positions[edge.first];
            const auto& q = cut.positions[edge.second];
            const bool in_face = (p[0] == q[0] && (p[0] == 0 || p[0] == 23)) ||
                                 (p[1] == q[1] && (p[1] == 0 || p[1] == 23));
            REQUIRE((count == 2 || in_face));
        }
    }
}

TEST_CASE("Vertices shared with other patches are kept, and so are the triangles at them") {
    Patch patch = torus(30, 12, 4, 1, 0.1);
    // A piece of it: other patches share the vertices along its rim.
    const std::vector<PatchTriangle> all = patch.triangles;
    patch.triangles.resize(all.size() / 2);
    finish(patch);
    std::vector<bool> elsewhere(patch.positions.size());
    for (std::size_t i = patch.triangles.size(); i < all.size(); ++i) {
        for (const std::uint32_t v : all[i]) {
            elsewhere[v] = true;
        }
    }
    patch.shared = elsewhere;
    const MappedPatch m = require_within(patch, 0.5);
    REQUIRE(m.triangles.size() < patch.triangles.size());
    const std::set<PatchTriangle> left(m.triangles.begin(), m.triangles.end());
    for (const PatchTriangle& t : patch.triangles) {
        const int shared = elsewhere[t[0]] + elsewhere[t[1]] + elsewhere[t[2]];
        REQUIRE((shared < 2 || left.contains(from_smallest(t))));
    }
}

TEST_CASE("Coincident vertices and triangles without area do no harm") {
    Patch patch = wavy_grid(20, 0.3);
    for (std::uint32_t v = 25; v < 380; v += 19) {
        patch.positions[v] = patch.positions[v + 1];  // across an edge
    }
    for (std::uint32_t v = 210; v < 330; v += 31) {
        patch.positions[v] = patch.positions[v - 60];  // far away along the mesh
    }
    MappedPatch m = mapped(patch);
    map_patch(m, limits_of(0.5));
    REQUIRE(m.triangles.size() < patch.triangles.size());
    REQUIRE(shape_of(m.triangles) == shape_of(patch.triangles));
    REQUIRE(sampled_distance(patch.positions, patch.triangles, m.triangles, 6) <= 0.5);
    REQUIRE(sampled_distance(patch.positions, m.triangles, patch.triangles, 6) <= 0.5);
}

TEST_CASE(
    "Whole meshes are mapped within a distance or to a number, with the same result for any "
    "threads") {
    Patch patch = torus(300, 100, 80, 24, 0.5);
    append(patch, wavy_grid(120, 0.5), {-60, -60, 20});
    for (auto& p : patch.positions) {
        p = {p[0] + 110, p[1] + 110, p[2] + 30};
    }
    const TemporaryFolder folder;
    ScratchMesh mesh(folder.path());
    fill(mesh, patch);
    WorldLattice lattice;
    lattice.nodes = {221, 221, 61};
    const std::vector<ElementCorners> full(mesh.corners().begin(), mesh.corners().end());
    constexpr std::uint64_t kTriangles = 6000;
    for (const double limit : {0.3, 1.5, 0.0}) {
        std::vector<ElementCorners> first;
        for (const int threads : {1, 3}) {
            std::vector<ElementCorners> result;
            double bound = 0;
            Workers(threads).execute([&] {
                MeshMapper mapper(mesh, lattice, {}, folder.path(), silent_progress());
                const Mapped whole = mapper.full(mesh.corners());
                const Mapped m = limit > 0 ? mapper.within(whole, limit)
                                           : mapper.down_to(whole, kTriangles, 0.1, 1e9);
                bound = m.bound;
                const CornerFile corners = mapper.corners(m);
                REQUIRE(corners.size() == m.triangles);
                result.assign(corners.all().begin(), corners.all().end());
            });
            if (threads > 1) {
                REQUIRE(result == first);
                continue;
            }
            first = result;
            if (limit > 0) {
                REQUIRE(bound <= limit);
                REQUIRE(result.size() < full.size() / 2);
            } else {
                REQUIRE(result.size() <= kTriangles);
                REQUIRE(result.size() > kTriangles * 9 / 10);
            }
            REQUIRE(shape_of(result) == shape_of(full));
            require_no_new_folds(patch.positions, full, result);
            const double most = bound * (1 + 1e-9);
            REQUIRE(sampled_distance(patch.positions, full, result, 3) <= most);
            REQUIRE(sampled_distance(patch.positions, result, full, 4) <= most);
        }
    }
}

TEST_CASE(
    "A surface that is released while it is mapped gives the same mesh, and is gone afterwards") {
    Patch patch = torus(300, 100, 60, 20, 0.3);
    for (auto& p : patch.positions) {
        p = {p[0] + 90, p[1] + 90, p[2] + 30};
    }
    const TemporaryFolder folder;
    ScratchMesh mesh(folder.path());
    fill(mesh, patch);
    WorldLattice lattice;
    lattice.nodes = {181, 181, 61};
    constexpr double kLimit = 0.5;
    std::vector<ElementCorners> full(mesh.corners().begin(), mesh.corners().end());
    const MeshMapper mapper(mesh, lattice, {}, folder.path(), silent_progress());
    const auto corners_within = [&](Mapped from) {
        const CornerFile corners = mapper.corners(mapper.within(std::move(from), kLimit));
        return std::vector<ElementCorners>(corners.all().begin(), corners.all().end());
    };
    const std::vector<ElementCorners> kept = corners_within(mapper.full(full));
    REQUIRE(corners_within(mapper.full(full)) == kept);
    std::vector<int> told(full.size());
    const std::vector<ElementCorners> consumed =
        corners_within(mapper.full(full, [&](std::uint64_t first, std::uint64_t count) {
            for (std::uint64_t i = first; i < first + count; ++i) {
                full[i] = {};
                ++told[i];
            }
        }));
    REQUIRE(consumed == kept);
    REQUIRE(std::all_of(told.begin(), told.end(), [](int times) { return times == 1; }));
}
