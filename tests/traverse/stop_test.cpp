// Any field as stop test or bound, tolerances that depend on the place, backface culling: the mesh
// is correct in every case.
#include <catch2/catch.hpp>
#include <set>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// A store of all fields, used for many extractions.
template <class T>
struct Subject {
    explicit Subject(FunctionVolume<T>& v) : volume(v) {
        PreprocessOptions p = with_chunk(8);
        p.fields = node_indicators();
        make_store(volume, folder / "s", p);
        store.emplace(folder / "s");
    }
    std::pair<Mesh, ExtractReport> extracted(const Extraction& options) {
        const ExtractReport r = extract(*store, folder / "m.ply", options, silent_progress());
        return {read_mesh(folder / "m.ply"), r};
    }
    void require_whole(const Mesh& mesh) const {
        const Int3 n = volume.nodes();
        Double3 high{};
        for (int a = 0; a < 3; ++a) {
            const auto i = static_cast<std::size_t>(a);
            high[i] = static_cast<double>(n[a] - 1) * volume.spacing_[i];
        }
        const MeshFaults f = check_mesh(mesh, {0, 0, 0}, high);
        CHECK(f.open_edges_inside == 0);
        CHECK(f.overused_edges == 0);
        CHECK(f.misoriented_edges == 0);
        CHECK(f.unused_vertices == 0);
    }
    TemporaryFolder folder;
    FunctionVolume<T>& volume;
    std::optional<StoreReader> store;
};

/// The distance from a ball's surface with some noise: a surface that no indicator finds flat.
double bumpy(const Int3& p) {
    return 11 -
           std::hypot(static_cast<double>(p.x) - 15.3, static_cast<double>(p.y) - 16.1,
                      static_cast<double>(p.z) - 14.7) +
           0.8 * smooth(p) + 0.1 * noise(p);
}

Double3 normal_of(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
    Double3 a{};
    Double3 b{};
    for (std::size_t i = 0; i < 3; ++i) {
        a[i] = static_cast<double>(mesh.vertices[t[1]][i]) - mesh.vertices[t[0]][i];
        b[i] = static_cast<double>(mesh.vertices[t[2]][i]) - mesh.vertices[t[0]][i];
    }
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

using Corners = std::multiset<std::array<float, 3>>;
std::multiset<Corners> triangles_of(const Mesh& mesh) {
    std::multiset<Corners> all;
    for (const auto& t : mesh.triangles) {
        all.insert({mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]});
    }
    return all;
}

}  // namespace

TEST_CASE(
    "every field as stop test gives a mesh without cracks, and larger thresholds give smaller "
    "meshes") {
    FunctionVolume<double> volume({31, 33, 30}, bumpy);
    volume.spacing_ = {1, 1.2, 0.9};
    Subject subject(volume);
    for (const Field field : node_indicators()) {
        std::size_t before = std::numeric_limits<std::size_t>::max();
        for (const double threshold : {0.0, 0.02, 0.2}) {
            CAPTURE(name_of(field), threshold);
            Extraction options;
            options.iso = 0.1;
            options.stop = field;
            options.threshold = threshold;
            options.threshold_relative = true;
            const auto [mesh, report] = subject.extracted(options);
            REQUIRE(!mesh.triangles.empty());
            subject.require_whole(mesh);
            CHECK(mesh.triangles.size() <= before);
            CHECK((threshold == 0 || report.error_bound < report.tolerance));
            before = mesh.triangles.size();
        }
    }
}

TEST_CASE("every bound gives the same surface") {
    FunctionVolume<double> volume({31, 33, 30}, bumpy);
    volume.spacing_ = {1, 1.2, 0.9};
    Subject subject(volume);
    for (const double error : {0.0, 0.3}) {
        std::optional<std::multiset<Corners>> expected;
        for (const Field bound : {Field::deviation_bar, Field::deviation_plus, Field::linf_plus,
                                  Field::grad_linf_plus}) {
            CAPTURE(name_of(bound), error);
            Extraction options;
            options.iso = 0.1;
            options.error = error;
            options.bound = bound;
            const auto [mesh, report] = subject.extracted(options);
            const auto triangles = triangles_of(mesh);
            if (!expected) {
                expected = triangles;
            }
            CHECK(triangles == *expected);
        }
    }
}

TEST_CASE("only backfaces are culled, by either bound, including some whole subtrees") {
    FunctionVolume<double> volume({31, 33, 30}, bumpy);
    volume.spacing_ = {1, 1.2, 0.9};
    Subject subject(volume);
    for (const double error : {0.0, 0.3}) {
        Extraction options;
        options.iso = 0.1;
        options.error = error;
        const auto [full, uncut] = subject.extracted(options);
        // Without a tolerance subtrees are not traversed: the finest tetrahedra are tested, and
        // before them the cubes of 8^3 cells.
        const bool finest = error == 0;
        std::uint64_t saved = 0;
        for (int i = 0; i < 12; ++i) {
            Double3 view{noise({i, 0, 0}) - 0.5, noise({i, 1, 0}) - 0.5, noise({i, 2, 0}) - 0.5};
            if (i < 3) {
                view = {0, 0, 0};
                view[static_cast<std::size_t>(i)] = 1;
            }
            for (const Field by : {Field::normal_turn_plus, Field::grad_linf_plus}) {
                CAPTURE(error, i, name_of(by));
                options.view = view;
                options.cull_by = by;
                const auto [cut, report] = subject.extracted(options);
                const std::uint64_t coarse = finest ? 2 * 6 * 5 * 5 * 5 : 0;
                CHECK(report.traversal.visited <= uncut.traversal.visited + coarse);
                CHECK(report.traversal.leaves < uncut.traversal.leaves);
                saved += finest ? 0 : uncut.traversal.visited - report.traversal.visited;
                const auto kept = triangles_of(cut);
                const auto all = triangles_of(full);
                std::size_t lost_front = 0;
                std::size_t kept_back = 0;
                for (const auto& t : full.triangles) {
                    const Double3 n = normal_of(full, t);
                    const double along =
                        (n[0] * view[0] + n[1] * view[1] + n[2] * view[2]) /
                        (std::hypot(n[0], n[1], n[2]) * std::hypot(view[0], view[1], view[2]));
                    const bool is_kept = kept.contains(
                        Corners{full.vertices[t[0]], full.vertices[t[1]], full.vertices[t[2]]});
                    // The normals of slivers are not known from float32 coordinates.
                    lost_front += along < -1e-3 && !is_kept ? 1 : 0;
                    kept_back += along > 1e-3 && is_kept ? 1 : 0;
                }
                CHECK(lost_front == 0);
                CHECK(kept_back == 0);
                CHECK(std::includes(all.begin(), all.end(), kept.begin(), kept.end()));
            }
        }
        CHECK((saved > 0) == !finest);
    }
}

TEST_CASE("bricks with only backfaces are not read, and the mesh is the same") {
    // A large ball: in a chunk of 8^3 nodes its surface has almost one direction. In a chunk of
    // 128^3 it has all directions, so that nothing is culled before the finest tetrahedra.
    FunctionVolume<float> volume({97, 97, 97}, [](const Int3& p) {
        const double x = static_cast<double>(p.x) - 48;
        const double y = static_cast<double>(p.y) - 48;
        const double z = static_cast<double>(p.z) - 48;
        return static_cast<float>(40 - std::sqrt(x * x + y * y + z * z));
    });
    const TemporaryFolder folder;
    PreprocessOptions fine = with_chunk(8);
    fine.fields = node_indicators();
    PreprocessOptions whole = with_chunk(128);
    whole.fields = node_indicators();
    whole.memory = std::uint64_t{8} << 30U;
    make_store(volume, folder / "fine", fine);
    make_store(volume, folder / "whole", whole);
    Extraction e;
    e.iso = 0.3;
    e.memory = std::uint64_t{8} << 30U;
    const StoreReader store(folder / "fine");
    const auto all = extract(store, folder / "all.ply", e, silent_progress());
    for (const Field by : {Field::normal_turn_plus, Field::grad_linf_plus}) {
        for (const Double3& view : {Double3{0, 0, 1}, Double3{1, 2, -0.5}}) {
            e.view = view;
            e.cull_by = by;
            const auto cut = extract(store, folder / "fine.ply", e, silent_progress());
            extract(StoreReader(folder / "whole"), folder / "whole.ply", e, silent_progress());
            CHECK(read_file(folder / "fine.ply") == read_file(folder / "whole.ply"));
            CHECK(cut.triangles < all.triangles);
            CHECK(cut.traversal.visited < all.traversal.visited * 9 / 10);
            CHECK(cut.traversal.bytes_read < all.traversal.bytes_read);
        }
    }
}

TEST_CASE("near the focus the error holds, far away the mesh is coarser, without cracks") {
    FunctionVolume<double> volume({33, 33, 33}, bumpy);
    Subject subject(volume);
    Extraction options;
    options.iso = 0.1;
    options.error = 0.05;
    const auto [even, even_report] = subject.extracted(options);
    options.focus = Focus{{4, 10, 10}, {8, 20, 20}, 0.5};
    const auto [mesh, report] = subject.extracted(options);
    subject.require_whole(mesh);
    CHECK(mesh.triangles.size() * 4 < even.triangles.size() * 3);
    std::size_t inside = 0;
    for (const auto& t : mesh.triangles) {
        Double3 p{};
        for (std::size_t a = 0; a < 3; ++a) {
            p[a] = (mesh.vertices[t[0]][a] + mesh.vertices[t[1]][a] + mesh.vertices[t[2]][a]) / 3;
        }
        Double3 away{};
        for (std::size_t a = 0; a < 3; ++a) {
            away[a] = std::max({options.focus->lo[a] - p[a], p[a] - options.focus->hi[a], 0.0});
        }
        const double distance = std::hypot(away[0], away[1], away[2]);
        const double off = std::fabs(fine_value(volume, p) - options.iso);
        CHECK(off <= 0.05 * (1 + 0.5 * distance) + 1e-5);
        inside += distance == 0 ? 1 : 0;
    }
    CHECK(inside > 0);
}

TEST_CASE("what appears small to a camera is not refined, and the mesh has no cracks") {
    FunctionVolume<double> volume({33, 33, 33}, bumpy);
    Subject subject(volume);
    Extraction options;
    options.iso = 0.1;
    options.camera = Camera{{-30, 16, 16}, 40, 200, 0.1};
    const auto [fine, fine_report] = subject.extracted(options);
    options.camera->pixels = 40;
    const auto [coarse, coarse_report] = subject.extracted(options);
    CHECK(coarse.triangles.size() * 4 < fine.triangles.size() * 3);
    subject.require_whole(coarse);
    // The near side has smaller triangles than the far one.
    std::array<std::pair<double, int>, 2> sides{};
    for (const auto& t : coarse.triangles) {
        const Double3 n = normal_of(coarse, t);
        auto& side = sides[coarse.vertices[t[0]][0] < 15.3F ? 0 : 1];
        side.first += std::hypot(n[0], n[1], n[2]);
        ++side.second;
    }
    CHECK(sides[0].first / sides[0].second < sides[1].first / sides[1].second);
}

TEST_CASE(
    "vertex normals point away from larger values, values and errors are those of the stores") {
    FunctionVolume<double> volume({33, 33, 33}, [](const Int3& p) {
        return 12 - std::hypot(static_cast<double>(p.x) - 16, static_cast<double>(p.y) - 16,
                               static_cast<double>(p.z) - 16);
    });
    Subject subject(volume);
    FunctionVolume<float> other({33, 33, 33},
                                [](const Int3& p) { return static_cast<float>(p.x + 2 * p.z); });
    make_store(other, subject.folder / "other", with_chunk(16));
    const Store values(subject.folder / "other");
    Extraction options;
    options.iso = 0.25;
    options.normals = true;
    options.values = &values;
    options.vertex_error = Field::deviation_bar;
    for (const double error : {0.0, 0.1}) {
        options.error = error;
        const auto [mesh, report] = subject.extracted(options);
        REQUIRE(!mesh.vertices.empty());
        double worst = 1;
        for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
            const auto& v = mesh.vertices[i];
            const auto& a = mesh.attributes[i];
            REQUIRE(a.size() == 5);
            const double r = std::hypot(v[0] - 16, v[1] - 16, v[2] - 16);
            worst =
                std::min(worst, (a[0] * (v[0] - 16) + a[1] * (v[1] - 16) + a[2] * (v[2] - 16)) / r);
            CHECK(a[3] == Approx(v[0] + 2 * v[2]).margin(1e-3));
            CHECK(a[4] >= 0);
        }
        CHECK(worst > 0.97);
    }
}
