// The study's counts and norms compared with an explicit recursion.
#include "query/study/study.h"

#include <catch2/catch.hpp>
#include <limits>

#include <isonest/error.h>

#include "store/lattice/simplex.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

struct Counted {
    std::uint64_t visited = 0;
    std::uint64_t leaves = 0;
    std::uint64_t surface_visited = 0;
    std::uint64_t surface_leaves = 0;
    double linf = 0;
};

constexpr double kIso = 0.45;

/// Refines by the oracle's indicator; compares U with each leaf's linear function at the nodes
/// inside it.
template <class T>
class Recursion {
  public:
    Recursion(const FunctionVolume<T>& volume, const BisectionOracle& oracle, double threshold)
        : volume_(volume), oracle_(oracle), threshold_(threshold) {}

    Counted run() {
        const Lattice lattice(volume_.nodes());
        const Int3 cells = lattice.cells_at(lattice.top());
        for (std::int64_t c = 0; c < cells.product(); ++c) {
            for (int order = 0; order < 6; ++order) {
                visit(kuhn_tetrahedron(cells.unlinear(c), std::int64_t{1} << lattice.top(), order),
                      true);
            }
        }
        return counted_;
    }

  private:
    /// `asks`: whether all ancestors are of interest for the isosurface.
    void visit(const Tetrahedron& t, bool asks) {
        Int3 low = t.v[0];
        Int3 high = t.v[0];
        for (const Int3& v : t.v) {
            low = min(low, v);
            high = max(high, v);
        }
        const Int3 n = volume_.nodes();
        if (t.kind == 0 && max(low + Int3{1, 1, 1}, n - Int3{1, 1, 1}) != n - Int3{1, 1, 1}) {
            return;  // outside the volume
        }
        ++counted_.visited;
        counted_.surface_visited += asks ? 1 : 0;
        double least = std::numeric_limits<double>::infinity();
        double most = -least;
        for (const Int3& v : t.v) {
            const double value = volume_.at(min(v, n - Int3{1, 1, 1}));
            least = std::min(least, value);
            most = std::max(most, value);
        }
        const Int3 d = high - low;
        if (std::max({d.x, d.y, d.z}) > 1) {
            const Int3 x = t.ref_node();
            const auto node = oracle_.nodes().find({x.x, x.y, x.z});
            if (node != oracle_.nodes().end() && node->second.of(Field::linf_bar) >= threshold_) {
                const double beta = node->second.of(Field::linf_plus);
                for (const Tetrahedron& child : t.bisect()) {
                    visit(child, asks && least - beta <= kIso && most + beta >= kIso);
                }
                return;
            }
        }
        ++counted_.leaves;
        counted_.surface_leaves += asks && least < kIso && most >= kIso ? 1 : 0;
        for (std::int64_t i = 0; i < (d + Int3{1, 1, 1}).product(); ++i) {
            compare(t, low + (d + Int3{1, 1, 1}).unlinear(i));
        }
    }

    void compare(const Tetrahedron& t, const Int3& p) {
        const Int3 last = volume_.nodes() - Int3{1, 1, 1};
        if (max(p, last) != last) {
            return;
        }
        const auto det = [](const Int3& a, const Int3& b, const Int3& c) {
            return static_cast<double>(a.x * (b.y * c.z - b.z * c.y) -
                                       a.y * (b.x * c.z - b.z * c.x) +
                                       a.z * (b.x * c.y - b.y * c.x));
        };
        const Int3 e1 = t.v[1] - t.v[0];
        const Int3 e2 = t.v[2] - t.v[0];
        const Int3 e3 = t.v[3] - t.v[0];
        const Int3 q = p - t.v[0];
        const double volume = det(e1, e2, e3);
        const double b1 = det(q, e2, e3) / volume;
        const double b2 = det(e1, q, e3) / volume;
        const double b3 = det(e1, e2, q) / volume;
        if (std::min({b1, b2, b3, 1 - b1 - b2 - b3}) < 0) {
            return;
        }
        const double linear = (1 - b1 - b2 - b3) * volume_.at(t.v[0]) + b1 * volume_.at(t.v[1]) +
                              b2 * volume_.at(t.v[2]) + b3 * volume_.at(t.v[3]);
        counted_.linf = std::max(counted_.linf, std::fabs(linear - volume_.at(p)));
    }

    const FunctionVolume<T>& volume_;
    const BisectionOracle& oracle_;
    double threshold_;
    Counted counted_;
};

}  // namespace

TEST_CASE("the study's counts and errors agree with an explicit recursion") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{12, 17, 6}}) {
        CAPTURE(n.x, n.y, n.z);
        FunctionVolume<double> volume(n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
        const TemporaryFolder folder;
        PreprocessOptions fields = with_chunk(8, true);
        fields.fields = {Field::linf_bar, Field::linf_plus};
        make_store(volume, folder / "s", fields);
        const StoreReader store(folder / "s");
        StudyOptions options;
        options.fields = {Field::linf_bar};
        options.steps = 7;
        options.least = 1e-2;
        options.iso = kIso;
        const Study s = study(store, options, silent_progress());
        const BisectionOracle oracle(n, [&](const Int3& p) { return volume.at(p); });
        double largest = 0;
        for (const auto& entry : oracle.nodes()) {
            largest = std::max(largest, entry.second.of(Field::linf_bar));
        }
        REQUIRE(s.rows.size() == 7);
        for (const StudyRow& row : s.rows) {
            // Slightly lower, because stored numbers are rounded.
            const Counted c = Recursion(volume, oracle, row.threshold * largest * (1 - 1e-6)).run();
            CAPTURE(row.threshold);
            CHECK(row.leaves == c.leaves);
            CHECK(row.visited == c.visited);
            CHECK(row.iso_visited == c.surface_visited);
            CHECK(row.iso_leaves == c.surface_leaves);
            CHECK(row.iso_efficiency(row.norms.l2) ==
                  Approx(1 / (static_cast<double>(c.surface_visited) * row.norms.l2)));
            CHECK(row.norms.linf * (store.max_value() - store.min_value()) ==
                  Approx(c.linf).margin(1e-6));
            CHECK(row.efficiency(row.norms.l2) ==
                  Approx(1 / (static_cast<double>(c.visited) * row.norms.l2)));
            CHECK(row.element_efficiency(row.norms.l2) ==
                  Approx(1 / (static_cast<double>(c.leaves) * row.norms.l2)));
            CHECK(row.norms.l1 <= row.norms.l2);
            CHECK(row.norms.l2 <= row.norms.linf);
        }
        CHECK(s.rows.front().leaves < s.rows.back().leaves);
        CHECK(s.rows.back().leaves <= s.all_elements);
        CHECK(s.rows.back().iso_visited < s.rows.back().visited);
        // The same for the same indicator if it is computed.
        options.fields = {*computed_field_from_name("lp:inf_bar")};
        options.threads = 1;
        const Study computed = study(store, options, silent_progress());
        for (std::size_t i = 0; i < s.rows.size(); ++i) {
            CHECK(static_cast<double>(computed.rows[i].iso_visited) ==
                  Approx(static_cast<double>(s.rows[i].iso_visited)).epsilon(0.01));
        }
    }
}

TEST_CASE("the study of a plane counts the triangles of the graph") {
    FunctionVolume<double> volume({33, 33, 1},
                                  [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8, true));
    const StoreReader store(folder / "s");
    StudyOptions options;
    options.fields = {Field::linf_bar, Field::deviation_bar};
    options.steps = 5;
    options.iso = 0.3;
    const Study s = study(store, options, silent_progress());
    CHECK(s.all_elements == 2 * 32 * 32);
    for (const StudyRow& row : s.rows) {
        Extraction e;
        e.graph_scale = 1;
        e.stop = std::get<Field>(row.field);
        e.threshold = row.threshold;
        e.threshold_relative = true;
        CHECK(extract(store, folder / "m.ply", e, silent_progress()).triangles == row.leaves);
        CHECK(row.iso_leaves <= row.iso_visited);
    }
    options.memory = 1;
    CHECK_THROWS(study(store, options, silent_progress()));
}
