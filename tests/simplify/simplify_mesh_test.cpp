// Patches and whole meshes that are simplified: distance and topology, counted independently.
#include "query/simplify/simplify_mesh.h"

#include <catch2/catch.hpp>

#include "query/simplify/simplify_patch.h"
#include "store/base/workers.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

void require_within(const Patch& patch, double limit) {
    const SimplifiedPatch s = simplify_patch(patch, simplify_limits(limit));
    REQUIRE(shape_of(s.triangles) == shape_of(patch.triangles));
    REQUIRE(s.largest <= limit);
    constexpr int kSteps = 6;
    const double most = limit * (1 + 1e-9);
    REQUIRE(sampled_distance(patch.positions, patch.fine, s.triangles, kSteps) <= most);
    REQUIRE(sampled_distance(patch.positions, s.triangles, patch.fine, kSteps) <= most);
    REQUIRE(s.first_server.size() == patch.fine.size() + 1);
    for (std::size_t i = 0; i < patch.fine.size(); ++i) {
        REQUIRE(s.servers_of(i).empty() == (patch.servers[i] == kNoServer));
        for_samples(patch.at(patch.fine[i]), 3, [&](const Double3& p) {
            const auto servers = s.servers_of(i);
            REQUIRE(std::any_of(servers.begin(), servers.end(), [&](std::uint32_t t) {
                return square_distance(p, patch.at(s.triangles[t])) <= most * most;
            }));
        });
    }
}

void fill(ScratchMesh& mesh, const Patch& patch) {
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

}  // namespace

TEST_CASE("Patches stay within the limit and of the same shape") {
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

TEST_CASE("Whole meshes of many blocks stay within the limit, the same for any threads") {
    Patch patch = torus(380, 120, 80, 24, 0.5);
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
    for (const double limit : {0.3, 1.5}) {
        std::vector<ElementCorners> first;
        for (const int threads : {1, 2, 4}) {
            if (threads > 1 && limit > 1) {
                break;
            }
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
            if (threads > 1) {
                REQUIRE(result == first);
                continue;
            }
            first = result;
            REQUIRE(bound <= limit);
            REQUIRE(result.size() < full.size() / 2);
            REQUIRE(shape_of(result) == shape_of(full));
            const double most = limit * (1 + 1e-9);
            REQUIRE(sampled_distance(patch.positions, full, result, 3) <= most);
            REQUIRE(sampled_distance(patch.positions, result, full, 4) <= most);
        }
    }
}
