// The study of a slice compared with an explicit recursion and points of the plane.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include <isonest/error.h>

#include "query/study/study.h"
#include "store/lattice/simplex.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kSpacing{1, 0.5, 2};

/// The mesh that refines the nodes whose indicator is at least a threshold, as explicit elements.
class ExplicitMesh {
  public:
    ExplicitMesh(const FunctionVolume<double>& volume, const BisectionOracle& oracle,
                 double threshold)
        : volume_(volume), oracle_(oracle), threshold_(threshold), lattice_(volume.nodes()) {}

    struct Counted {
        std::uint64_t visited = 0;
        std::uint64_t leaves = 0;
    };
    /// Counts the elements that are tested for an intersection that has an area, and the leaves
    /// that have one.
    [[nodiscard]] Counted cut_by(const WorldPlane& plane) const {
        Counted counted;
        for_roots([&](const Tetrahedron& t) { count(t, plane, counted); });
        return counted;
    }
    /// The linear function of the leaf at a point of the volume, in lattice coordinates.
    [[nodiscard]] double at(const Double3& p) const {
        double value = 0;
        bool found = false;
        for_roots([&](const Tetrahedron& t) {
            if (!found && holds(t, p)) {
                value = in(t, p);
                found = true;
            }
        });
        return value;
    }

  private:
    template <class F>
    void for_roots(const F& f) const {
        const Int3 cells = lattice_.cells_at(lattice_.top());
        for (std::int64_t c = 0; c < cells.product(); ++c) {
            for (int order = 0; order < 6; ++order) {
                f(kuhn_tetrahedron(cells.unlinear(c), std::int64_t{1} << lattice_.top(), order));
            }
        }
    }
    [[nodiscard]] bool refines(const Tetrahedron& t) const {
        Int3 low = t.v[0];
        Int3 high = t.v[0];
        for (const Int3& v : t.v) {
            low = min(low, v);
            high = max(high, v);
        }
        const Int3 d = high - low;
        if (std::max({d.x, d.y, d.z}) <= 1) {
            return false;
        }
        const Int3 x = t.ref_node();
        const auto node = oracle_.nodes().find({x.x, x.y, x.z});
        return node != oracle_.nodes().end() && node->second.of(Field::linf_bar) >= threshold_;
    }
    void count(const Tetrahedron& t, const WorldPlane& plane, Counted& counted) const {
        Int3 low = t.v[0];
        int below = 0;
        int above = 0;
        int in_plane = 0;
        for (const Int3& v : t.v) {
            low = min(low, v);
            double distance = -plane.offset;
            for (int axis = 0; axis < 3; ++axis) {
                const auto a = static_cast<std::size_t>(axis);
                distance += plane.normal[a] * kSpacing[a] * static_cast<double>(v[axis]);
            }
            (distance < 0 ? below : distance > 0 ? above : in_plane) += 1;
        }
        const Int3 last = volume_.nodes() - Int3{1, 1, 1};
        if (t.kind == 0 && max(low + Int3{1, 1, 1}, last) != last) {
            return;
        }
        ++counted.visited;
        if (below == 0 || (above == 0 && in_plane < 3)) {
            return;
        }
        if (!refines(t)) {
            ++counted.leaves;
            return;
        }
        for (const Tetrahedron& child : t.bisect()) {
            count(child, plane, counted);
        }
    }

    static double det(const Double3& a, const Double3& b, const Double3& c) {
        return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    static Double3 from(const Int3& a, const Double3& p) {
        return {p[0] - static_cast<double>(a.x), p[1] - static_cast<double>(a.y),
                p[2] - static_cast<double>(a.z)};
    }
    static std::array<double, 4> barycentric(const Tetrahedron& t, const Double3& p) {
        std::array<Double3, 4> e;
        for (std::size_t i = 1; i < 4; ++i) {
            const Int3 d = t.v[i] - t.v[0];
            e[i] = {static_cast<double>(d.x), static_cast<double>(d.y), static_cast<double>(d.z)};
        }
        const Double3 q = from(t.v[0], p);
        const double size = det(e[1], e[2], e[3]);
        std::array<double, 4> b{0, det(q, e[2], e[3]) / size, det(e[1], q, e[3]) / size,
                                det(e[1], e[2], q) / size};
        b[0] = 1 - b[1] - b[2] - b[3];
        return b;
    }
    static bool holds(const Tetrahedron& t, const Double3& p) {
        const auto b = barycentric(t, p);
        return *std::min_element(b.begin(), b.end()) >= -1e-9;
    }
    [[nodiscard]] double in(const Tetrahedron& t, const Double3& p) const {
        if (refines(t)) {
            const auto children = t.bisect();
            return in(holds(children[0], p) ? children[0] : children[1], p);
        }
        const auto b = barycentric(t, p);
        double value = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            value += b[i] * volume_.at(t.v[i]);
        }
        return value;
    }

    const FunctionVolume<double>& volume_;
    const BisectionOracle& oracle_;
    double threshold_;
    Lattice lattice_;
};

/// Points of the plane inside the volume, uniformly distributed by area, in lattice coordinates.
std::vector<Double3> points_of(const WorldPlane& plane, const Int3& n) {
    std::vector<Double3> points;
    constexpr int kPerAxis = 120;
    // Solves for z if the plane is not parallel to it, else for x.
    const std::size_t solved = plane.normal[2] != 0 ? 2 : 0;
    const std::size_t u = solved == 2 ? 0 : 1;
    const std::size_t v = solved == 2 ? 1 : 2;
    for (int i = 0; i < kPerAxis; ++i) {
        for (int j = 0; j < kPerAxis; ++j) {
            Double3 p{};
            p[u] = (i + 0.5) / kPerAxis * static_cast<double>(n[static_cast<int>(u)] - 1);
            p[v] = (j + 0.5) / kPerAxis * static_cast<double>(n[static_cast<int>(v)] - 1);
            double rest = plane.offset;
            for (const std::size_t a : {u, v}) {
                rest -= plane.normal[a] * kSpacing[a] * p[a];
            }
            p[solved] = rest / (plane.normal[solved] * kSpacing[solved]);
            if (p[solved] >= 0 &&
                p[solved] <= static_cast<double>(n[static_cast<int>(solved)] - 1)) {
                points.push_back(p);
            }
        }
    }
    return points;
}

}  // namespace

TEST_CASE("the study of a slice agrees with an explicit recursion on the plane") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{12, 17, 6}}) {
        FunctionVolume<double> volume(n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
        volume.spacing_ = kSpacing;
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(8, true));
        const StoreReader store(folder / "s");
        const BisectionOracle oracle(
            n, [&](const Int3& p) { return volume.at(p); }, kSpacing);
        double largest = 0;
        for (const auto& entry : oracle.nodes()) {
            largest = std::max(largest, entry.second.of(Field::linf_bar));
        }
        const ExplicitMesh finest(volume, oracle, 0);
        // Through nodes, along the diagonal, and anywhere else.
        for (const WorldPlane& plane : {WorldPlane{{0, 0, 1}, 6}, WorldPlane{{0, 2, 1}, 8},
                                        WorldPlane{{1, 0.7, 0.3}, 9.137}}) {
            CAPTURE(n.x, n.y, n.z, plane.normal[0], plane.normal[1]);
            StudyOptions options;
            options.fields = {Field::linf_bar};
            options.steps = 4;
            options.least = 1e-2;
            options.plane = plane;
            const Study s = study(store, options, silent_progress());
            REQUIRE(s.rows.size() == 4);
            const std::vector<Double3> points = points_of(plane, n);
            REQUIRE(points.size() > 1000);
            for (const StudyRow& row : s.rows) {
                CAPTURE(row.threshold);
                // Slightly lower, because stored numbers are rounded.
                const ExplicitMesh mesh(volume, oracle, row.threshold * largest * (1 - 1e-6));
                const auto counted = mesh.cut_by(plane);
                CHECK(row.leaves == counted.leaves);
                CHECK(row.visited == counted.visited);
                ErrorNorms sampled;
                for (const Double3& p : points) {
                    const double e = std::fabs(mesh.at(p) - finest.at(p)) /
                                     (store.max_value() - store.min_value());
                    sampled.l1 += e / static_cast<double>(points.size());
                    sampled.l2 += e * e / static_cast<double>(points.size());
                    sampled.linf = std::max(sampled.linf, e);
                }
                CHECK(row.norms.l1 == Approx(sampled.l1).epsilon(0.03).margin(1e-7));
                CHECK(row.norms.l2 == Approx(std::sqrt(sampled.l2)).epsilon(0.03).margin(1e-7));
                CHECK(row.norms.linf >= sampled.linf * (1 - 1e-6));
                CHECK(row.norms.linf == Approx(sampled.linf).epsilon(0.2).margin(1e-7));
            }
            CHECK(s.all_elements == finest.cut_by(plane).leaves);
            CHECK(s.rows.front().norms.l2 > s.rows.back().norms.l2);
        }
    }
}

TEST_CASE("the study of a slice counts the elements of the slice") {
    const Int3 n{33, 33, 33};
    FunctionVolume<float> volume(
        n, [](const Int3& p) { return static_cast<float>(smooth(p) + 0.1 * noise(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8, true));
    const StoreReader store(folder / "s");
    // No element of the refined cube crosses these planes: each has a face in it.
    for (const double z : {0.0, 16.0, 32.0}) {
        StudyOptions options;
        options.fields = {Field::deviation_bar};
        options.steps = 3;
        options.plane = WorldPlane{{0, 0, 1}, z};
        const Study s = study(store, options, silent_progress());
        for (const StudyRow& row : s.rows) {
            Extraction e;
            e.plane = options.plane;
            e.stop = std::get<Field>(row.field);
            e.threshold = row.threshold;
            e.threshold_relative = true;
            CHECK(extract(store, folder / "m.ply", e, silent_progress()).triangles == row.leaves);
        }
    }
}

TEST_CASE("a study of a slice refuses invalid queries") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({9, 9, 9}, [](const Int3& p) { return static_cast<float>(p.x); });
    make_store(volume, folder / "s", with_chunk(8, true));
    FunctionVolume<float> map({9, 9, 1}, [](const Int3& p) { return static_cast<float>(p.x); });
    make_store(map, folder / "map", with_chunk(8, true));
    const StoreReader store(folder / "s");
    StudyOptions options;
    options.fields = {Field::linf_bar};
    options.plane = WorldPlane{{0, 0, 1}, 20};
    CHECK_THROWS_AS(study(store, options, silent_progress()), Error);
    options.plane = WorldPlane{{0, 0, 1}, 4};
    CHECK_NOTHROW(study(store, options, silent_progress()));
    CHECK_THROWS_AS(study(StoreReader(folder / "map"), options, silent_progress()), Error);
    options.iso = 3;
    CHECK_THROWS_AS(study(store, options, silent_progress()), Error);
}
