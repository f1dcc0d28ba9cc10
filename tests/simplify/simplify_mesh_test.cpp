// Simplified patches and whole meshes: distance and topology, measured independently.
#include "query/simplify/simplify_mesh.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <numeric>
#include <set>

#include "query/simplify/simplify_patch.h"
#include "store/base/workers.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// The old positions of the patch's vertices, followed by the new positions with the subsequent
/// numbers.
std::vector<std::array<float, 3>> both_positions(const Patch& patch, const SimplifiedPatch& s) {
    std::vector<std::array<float, 3>> positions = patch.positions;
    positions.insert(positions.end(), patch.positions.begin(), patch.positions.end());
    for (const SimplifiedPatch::Moved& moved : s.moved) {
        positions[patch.positions.size() + moved.vertex] = moved.to;
    }
    return positions;
}

std::vector<PatchTriangle> shifted(std::vector<PatchTriangle> triangles, std::size_t by) {
    for (PatchTriangle& t : triangles) {
        for (std::uint32_t& v : t) {
            v += static_cast<std::uint32_t>(by);
        }
    }
    return triangles;
}

SimplifiedPatch require_within(const Patch& patch, double limit) {
    const SimplifiedPatch s = simplify_patch(patch, simplify_limits(limit));
    REQUIRE(shape_of(s.triangles) == shape_of(patch.triangles));
    REQUIRE(s.largest <= limit);
    constexpr int kSteps = 6;
    const double most = limit * (1 + 1e-9);
    const auto positions = both_positions(patch, s);
    const auto triangles = shifted(s.triangles, patch.positions.size());
    REQUIRE(sampled_distance(positions, patch.fine, triangles, kSteps) <= most);
    REQUIRE(sampled_distance(positions, triangles, patch.fine, kSteps) <= most);
    REQUIRE(s.first_witness.size() == patch.fine.size() + 1);
    for (std::size_t i = 0; i < patch.fine.size(); ++i) {
        REQUIRE(s.witnesses_of(i).empty() == (patch.witnesses[i] == kNoWitness));
        for_samples(patch.at(patch.fine[i]), 3, [&](const Double3& p) {
            const auto witnesses = s.witnesses_of(i);
            REQUIRE(std::any_of(witnesses.begin(), witnesses.end(), [&](std::uint32_t t) {
                return square_distance(p, triangle_at(positions, triangles[t])) <= most * most;
            }));
        });
    }
    std::set<std::uint32_t> there;
    for (const PatchTriangle& t : s.triangles) {
        there.insert(t.begin(), t.end());
    }
    for (const SimplifiedPatch::Moved& moved : s.moved) {
        REQUIRE(there.contains(moved.vertex));
        REQUIRE(moved.to != patch.positions[moved.vertex]);
        REQUIRE(!patch.shared[moved.vertex]);
    }
    return s;
}

}  // namespace

TEST_CASE("Patches stay within the limit and keep their topology") {
    for (const double limit : {0.05, 0.3, 1.5, 30.0}) {
        require_within(wavy_grid(25, 0.4), limit);
        require_within(torus(40, 16, 5, 1.5, 0.2), limit);
        Patch both = wavy_grid(25, 0.2);
        append(both, torus(24, 10, 3, 0.8, 0.1), {12, 12, 1.5F});
        require_within(both, limit);
        Patch partly = torus(30, 12, 4, 1, 0.1);
        for (std::size_t v = 0; v < partly.shared.size(); ++v) {
            partly.shared[v] = v % 7 == 0;
        }
        for (std::size_t i = 0; i < partly.fine.size(); ++i) {
            partly.stay[i] = i % 31 == 0 ? Stay::forever : i % 37 == 0 ? Stay::now : Stay::no;
        }
        require_within(partly, limit);
        const SimplifiedPatch s = simplify_patch(partly, simplify_limits(limit));
        std::set<PatchTriangle> kept;
        for (std::size_t i = 0; i < s.triangles.size(); ++i) {
            if (s.kept[i]) {
                kept.insert(s.triangles[i]);
            }
        }
        const std::set<PatchTriangle> there(s.triangles.begin(), s.triangles.end());
        for (std::size_t i = 0; i < partly.triangles.size(); ++i) {
            const PatchTriangle t = from_smallest(partly.triangles[i]);
            REQUIRE(kept.contains(t) == (partly.stay[i] == Stay::forever));
            REQUIRE((partly.stay[i] == Stay::no || there.contains(t)));
        }
    }
}

TEST_CASE("Vertices leave a curved surface if that saves triangles, but do not leave its border") {
    const Patch round = torus(60, 40, 20, 8, 0);
    REQUIRE(require_within(round, 0.3).moved.size() > 20);
    const Patch grid = wavy_grid(30, 0.6);
    for (const SimplifiedPatch::Moved& moved : require_within(grid, 0.3).moved) {
        const std::uint32_t x = moved.vertex % 30;
        const std::uint32_t y = moved.vertex / 30;
        REQUIRE((x > 0 && x < 29 && y > 0 && y < 29));
    }
    Patch box = round;
    box.box.lo = {-100, -100, -7.9F};
    box.box.hi = {100, 100, 7.9F};
    for (const SimplifiedPatch::Moved& moved : require_within(box, 0.3).moved) {
        REQUIRE((moved.to[2] > -7.9F && moved.to[2] < 7.9F));
    }
}

TEST_CASE(
    "Moved vertices that coincide with others get separate positions, and nothing else moves") {
    const TemporaryFolder folder;
    ScratchMesh mesh(folder.path());
    fill(mesh, wavy_grid(4, 0.5));
    MovedVertices vertices(mesh, folder.path());
    REQUIRE(vertices.empty());
    const std::vector<std::array<float, 3>> before(mesh.positions().begin(),
                                                   mesh.positions().end());
    MovedVertices::Copies copies(folder.path());
    for (int i = 0; i < 5; ++i) {
        copies.append({before[3], 7});  // at the position of a vertex of the surface
    }
    copies.append({{1.5F, 2.5F, 3.5F}, 2});
    copies.append({{1.5F, 2.5F, 3.5F}, 1});
    copies.append({{9, 9, 9}, 4});
    vertices.add(copies);
    REQUIRE(vertices.next() == 24);
    REQUIRE(vertices.origin_of(3) == 3);
    REQUIRE(vertices.origin_of(16) == 7);
    REQUIRE(vertices.origin_of(22) == 1);
    std::vector<std::uint64_t> all(24);
    const auto places = [&] {
        return std::set<std::array<float, 3>>(mesh.positions().begin(), mesh.positions().end());
    };
    std::iota(all.begin(), all.end(), 0U);
    REQUIRE(places().size() == 18);
    REQUIRE(vertices.give_own_places(all, 0) == 0);
    REQUIRE(places().size() == 18);
    const double moved = vertices.give_own_places(all, 1e-5);
    REQUIRE((moved > 0 && moved <= 1e-5));
    REQUIRE(places().size() == 24);
    for (std::size_t v = 0; v < before.size(); ++v) {
        REQUIRE(mesh.positions()[v] == before[v]);
    }
    REQUIRE(mesh.positions()[23] == std::array<float, 3>{9, 9, 9});
    REQUIRE(std::fabs(mesh.positions()[22][0] - 1.5F) <= 1e-6F);
    REQUIRE(vertices.give_own_places(all, 1e-5) == 0);
}

TEST_CASE("A small torus or an open tube near a plane does not vanish") {
    Patch patch = wavy_grid(30, 0);
    append(patch, torus(16, 8, 2, 0.7, 0), {14, 14, 1});
    require_within(patch, 6);
    Patch tube = torus(16, 8, 2, 0.7, 0);
    tube.triangles.resize(tube.triangles.size() - 16);  // between two rings
    finish(tube);
    patch = wavy_grid(30, 0);
    append(patch, tube, {14, 14, 1});
    require_within(patch, 6);
}

TEST_CASE(
    "Whole meshes of many blocks stay within the limit, with the same result for any threads") {
    Patch patch = torus(380, 120, 80, 24, 0.5);
    append(patch, wavy_grid(120, 0.5), {-60, -60, 20});
    for (auto& p : patch.positions) {
        p = {p[0] + 110, p[1] + 110, p[2] + 30};
    }
    const TemporaryFolder folder;
    WorldLattice lattice;
    lattice.nodes = {221, 221, 61};
    for (const double limit : {0.3, 1.5}) {
        std::vector<ElementCorners> first;
        std::vector<std::array<float, 3>> first_positions;
        for (const int threads : {1, 2, 4}) {
            if (threads > 1 && limit > 1) {
                break;
            }
            ScratchMesh mesh(folder.path());
            fill(mesh, patch);
            const std::vector<ElementCorners> full(mesh.corners().begin(), mesh.corners().end());
            std::vector<ElementCorners> result;
            double bound = 0;
            Workers(threads).execute([&] {
                MeshSimplifier simplifier(mesh, mesh.corners(), lattice, {}, folder.path(),
                                          silent_progress());
                const Simplified s = simplifier.within(simplifier.full(), limit);
                bound = s.bound;
                const CornerFile corners = simplifier.corners(s);
                REQUIRE(corners.size() == s.triangles);
                result.assign(corners.all().begin(), corners.all().end());
            });
            const std::vector<std::array<float, 3>> positions(mesh.positions().begin(),
                                                              mesh.positions().end());
            if (threads > 1) {
                REQUIRE(result == first);
                REQUIRE(positions == first_positions);
                continue;
            }
            REQUIRE(positions.size() > patch.positions.size());
            first = result;
            first_positions = positions;
            REQUIRE(bound <= limit);
            REQUIRE(result.size() < full.size() / 2);
            REQUIRE(shape_of(result) == shape_of(full));
            const double most = limit * (1 + 1e-9);
            REQUIRE(sampled_distance(positions, full, result, 3) <= most);
            REQUIRE(sampled_distance(positions, result, full, 4) <= most);
        }
    }
}
