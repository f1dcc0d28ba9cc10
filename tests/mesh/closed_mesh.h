// Shared by the tests of closed surfaces: meshes, whether they are watertight, and their volume.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "query/simplify/patch.h"
#include "tests/support/test_support.h"

namespace isonest::detail::test {

/// The result of closed().
struct Closed {
    Mesh mesh;
    std::string bytes;
    ExtractReport report;
};

/// The options of closed().
struct Settings {
    double error = 0;
    std::optional<WorldBox> box;
    Outside outside = Outside::below;
    int threads = 2;
    std::uint64_t memory = 1U << 30U;
    bool normals = false;
    Cells cells = Cells::tetrahedra;
};

/// The closed surface, extracted to a file.
inline Closed closed(const StoreReader& store, double iso, const Settings& with) {
    const TemporaryFolder folder;
    Extraction e;
    e.iso = iso;
    e.error = with.error;
    e.box = with.box;
    e.close = with.outside;
    e.threads = with.threads;
    e.memory = with.memory;
    e.normals = with.normals;
    e.cells = with.cells;
    Closed r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    CHECK(r.mesh.triangles.size() == r.report.triangles);
    return r;
}

/// The enclosed volume in world units; positive if the triangles face outward.
inline double enclosed(const Mesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.triangles) {
        const Triangle p = triangle_at(mesh.vertices, t);
        sum += dot(p[0], cross(p[1], p[2]));
    }
    return sum / 6;
}

inline void require_watertight(const Mesh& mesh) {
    // Without faces at which edges may be open.
    const MeshFaults faults = check_mesh(mesh, {-1e9, -1e9, -1e9}, {1e9, 1e9, 1e9});
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
    CHECK(faults.split_vertices == 0);
    for (const auto& t : mesh.triangles) {
        CHECK((t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    }
}

inline float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}

}  // namespace isonest::detail::test
