// Indicators computed by the study, compared with the store's, explicit bisection and known shapes.
#include "query/study/computed_field.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include <isonest/error.h>

#include "query/study/study.h"
#include "store/base/vectors.h"
#include "store/lattice/simplex.h"
#include "tests/support/loaded_lattice.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kSpacing{1, 0.5, 2};

ComputedField field_named(const char* name) {
    const std::optional<ComputedField> field = computed_field_from_name(name);
    REQUIRE(field);
    return *field;
}

/// Calls f(p, node) for all refinement nodes of elements.
template <class F>
void for_refinement_nodes(const Lattice& lattice, const F& f) {
    for (int level = 1; level <= lattice.top(); ++level) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        const Int3 size = lattice.cells_at(level) * 2 + Int3{1, 1, 1};
        for (std::int64_t i = 0; i < size.product(); ++i) {
            const Int3 p = size.unlinear(i) * scale;
            const NodeInfo node = describe_node(p, lattice.top());
            if (node.scale == scale) {
                f(p, node);
            }
        }
    }
}

struct Loaded : LoadedLattice {
    Loaded(const Int3& n, const std::function<double(const Int3&)>& f, PreprocessOptions options)
        : LoadedLattice(n, f, kSpacing, std::move(options)) {}
};

PreprocessOptions all_computed_fields() {
    PreprocessOptions options = with_chunk(8, true);
    options.fields = node_indicators();
    return options;
}

}  // namespace

TEST_CASE("computed indicators with the store's powers agree with those of the store") {
    const std::map<std::string, Indicator> same{
        {"lp:1", Indicator::l1},           {"lp:2", Indicator::l2},
        {"lp:inf", Indicator::linf},       {"grad_lp:1", Indicator::grad_l1},
        {"grad_lp:2", Indicator::grad_l2}, {"grad_lp:inf", Indicator::grad_linf}};
    for (const Int3& n : {Int3{17, 17, 17}, Int3{12, 17, 6}, Int3{17, 1, 11}, Int3{1, 21, 1}}) {
        Loaded l(
            n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); }, all_computed_fields());
        WholeLattice stored(l.store->layout());
        stored.load_values(*l.cache);
        for (const auto& [name, indicator] : same) {
            for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
                ComputedField field = field_named(name.c_str());
                field.saturation = saturation;
                CAPTURE(n.x, n.y, n.z, name_of(field));
                const double largest =
                    compute_indicator(*l.whole, field, kSpacing, silent_progress());
                const double expected = stored.load_indicator(
                    *l.cache, field_of(indicator, saturation), silent_progress());
                CHECK(largest == Approx(expected));
                int wrong = 0;
                for_refinement_nodes(l.whole->lattice(), [&](const Int3& p, const NodeInfo&) {
                    const auto a = static_cast<double>(l.whole->indicator(p));
                    const auto b = static_cast<double>(stored.indicator(p));
                    wrong += a == Approx(b).epsilon(1e-5).margin(1e-6 * expected) ? 0 : 1;
                });
                CHECK(wrong == 0);
            }
        }
    }
}

TEST_CASE(
    "computed indicators with other powers are sums over the elements of explicit bisection") {
    constexpr double kPower = 3.5;
    const Int3 n{9, 9, 9};
    Loaded l(
        n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); }, with_chunk(8, true));
    // For the elements refined at a node, the sums of their sizes and of the gradient of its hat
    // function to the power.
    std::map<std::array<std::int64_t, 3>, std::pair<double, double>> sums;
    const auto simplex_of = [](const Tetrahedron& t) {
        Simplex s;
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                s.v[i][a] = static_cast<double>(t.v[i][static_cast<int>(a)]) * kSpacing[a];
            }
        }
        return s;
    };
    std::vector<Tetrahedron> left;
    for (int order = 0; order < 6; ++order) {
        left.push_back(kuhn_tetrahedron({0, 0, 0}, 8, order));
    }
    while (!left.empty()) {
        const Tetrahedron t = left.back();
        left.pop_back();
        const Int3 d = max(t.v[0], max(t.v[1], max(t.v[2], t.v[3]))) -
                       min(t.v[0], min(t.v[1], min(t.v[2], t.v[3])));
        if (std::max({d.x, d.y, d.z}) == 1) {
            continue;
        }
        const Int3 x = t.ref_node();
        auto& [size, hat] = sums[{x.x, x.y, x.z}];
        size += simplex_of(t).measure();
        for (const Tetrahedron& half : t.bisect()) {
            const Simplex s = simplex_of(half);
            for (std::size_t i = 0; i < 4; ++i) {
                if (half.v[i] == x) {
                    hat += s.measure() * std::pow(length(s.gradient_weights()[i]), kPower);
                }
            }
            left.push_back(half);
        }
    }
    for (const bool gradient : {false, true}) {
        const ComputedField field = field_named(gradient ? "grad_lp:3.5" : "lp:3.5");
        compute_indicator(*l.whole, field, kSpacing, silent_progress());
        int nodes = 0;
        for_refinement_nodes(l.whole->lattice(), [&](const Int3& p, const NodeInfo& node) {
            const double offset =
                std::fabs(l.volume.at(p) - (l.volume.at(node.end0) + l.volume.at(node.end1)) / 2);
            const auto& [size, hat] = sums.at({p.x, p.y, p.z});
            const double eta = gradient ? offset * std::pow(hat, 1 / kPower)
                                        : offset * std::pow(size, 1 / kPower) / 4;
            CHECK(static_cast<double>(l.whole->indicator(p)) == Approx(eta).margin(1e-9));
            ++nodes;
        });
        CHECK(nodes == 9 * 9 * 9 - 8);
    }
}

TEST_CASE("gradient and curvature agree with those of spheres and circles") {
    for (const Int3& n : {Int3{33, 33, 33}, Int3{33, 33, 1}}) {
        const auto radius = [&](const Int3& p) {
            const double x = static_cast<double>(p.x) * kSpacing[0] + 12;
            const double y = static_cast<double>(p.y) * kSpacing[1] + 9;
            const double z = n.z > 1 ? static_cast<double>(p.z) * kSpacing[2] + 15 : 0;
            return std::sqrt(x * x + y * y + z * z);
        };
        Loaded l(
            n, [&](const Int3& p) { return 3 * radius(p); }, with_chunk(8, true));
        const double curvatures = n.z > 1 ? std::sqrt(2.0) : 1;
        for (const char* name : {"gradient", "curvature"}) {
            compute_indicator(*l.whole, field_named(name), kSpacing, silent_progress());
            double worst = 0;
            for_refinement_nodes(l.whole->lattice(), [&](const Int3& p, const NodeInfo&) {
                const bool inside =
                    std::min({p.x, p.y, n.z > 1 ? p.z : 1}) > 0 && std::max({p.x, p.y, p.z}) < 32;
                const double expected =
                    name == std::string("gradient") ? 3 : curvatures / radius(p);
                const auto found = static_cast<double>(l.whole->indicator(p));
                worst = inside ? std::max(worst, std::fabs(found / expected - 1)) : worst;
            });
            CAPTURE(n.z, name);
            CHECK(worst < 0.02);
        }
    }
    // Without a gradient the curvature is 0.
    Loaded flat(
        {9, 9, 9}, [](const Int3&) { return 1.0; }, with_chunk(8, true));
    CHECK(compute_indicator(*flat.whole, field_named("curvature"), kSpacing, silent_progress()) ==
          0);
}

TEST_CASE("names of computed fields are parsed and printed") {
    for (const char* name : {"lp:1", "lp:2.5_bar", "lp:inf_plus", "grad_lp:7_plus", "grad_lp:inf",
                             "gradient_bar", "curvature", "curvature_plus", "graph_curvature_bar",
                             "deviation_lp:2", "deviation_lp:64_bar", "deviation_lp:inf_plus",
                             "deviation_grad_lp:1.5", "deviation_graph_bar"}) {
        CHECK(name_of(field_named(name)) == name);
    }
    for (const char* name : {"lp",
                             "lp:",
                             "lp:0.5",
                             "lp:nan",
                             "lp:2x",
                             "lp:-1",
                             "grad_lp:",
                             "linf",
                             "linf_bar",
                             "gradient_sum",
                             "",
                             "_bar",
                             "lp:1e999",
                             "gradient:2",
                             "deviation",
                             "deviation_bar",
                             "deviation_lp",
                             "deviation_lp:65",
                             "deviation_graph:1",
                             "deviation_grad_lp:0"}) {
        CAPTURE(name);
        CHECK_FALSE(computed_field_from_name(name));
    }
}

TEST_CASE("a study of a computed indicator agrees with that of the store's") {
    Loaded l(
        {17, 17, 17}, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); },
        all_computed_fields());
    StudyOptions options;
    options.fields = {Field::l2_bar, field_named("lp:2_bar")};
    options.steps = 5;
    const Study s = study(*l.store, options, silent_progress());
    REQUIRE(s.rows.size() == 10);
    for (std::size_t i = 0; i < 5; ++i) {
        // The store's are rounded up, so that a threshold may lie between the two.
        CHECK(static_cast<double>(s.rows[i].leaves) ==
              Approx(static_cast<double>(s.rows[i + 5].leaves)).epsilon(0.01));
        CHECK(s.rows[i].norms.l2 == Approx(s.rows[i + 5].norms.l2).epsilon(0.01));
        CHECK(name_of(s.rows[i + 5].field) == "lp:2_bar");
    }
    options.fields = {field_named("lp:2")};
    CHECK_THROWS_AS(study(*l.store, options, silent_progress()), Error);
}

TEST_CASE("a computed indicator is infinite at and above missing values") {
    Loaded l(
        {9, 9, 9},
        [](const Int3& p) {
            return p == Int3{3, 4, 5} ? std::numeric_limits<double>::quiet_NaN() : smooth(p);
        },
        with_chunk(8, true));
    const double largest =
        compute_indicator(*l.whole, field_named("lp:3_bar"), kSpacing, silent_progress());
    CHECK(std::isfinite(largest));
    CHECK(std::isinf(l.whole->indicator({3, 4, 5})));
    CHECK(std::isinf(l.whole->indicator({4, 4, 4})));
    CHECK(std::isfinite(l.whole->indicator({1, 1, 1})));
}

TEST_CASE("a computed indicator is exported unchanged") {
    const Int3 n{12, 17, 6};
    Loaded l(
        n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); }, with_chunk(8, true));
    const TemporaryFolder folder;
    for (const int level : {0, 2}) {
        export_computed_field(*l.store, folder / "eta.raw", {field_named("lp:inf"), level, true},
                              silent_progress());
        const std::string bytes = read_file(folder / "eta.raw");
        REQUIRE(bytes.size() == static_cast<std::size_t>(n.product()) * sizeof(float));
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = n.unlinear(i);
            const NodeInfo node = describe_node(p, l.whole->lattice().top());
            float found = 0;
            std::memcpy(&found, bytes.data() + static_cast<std::size_t>(i) * sizeof(float),
                        sizeof(float));
            const bool is_wanted = node.scale > 0 && node.level() >= level;
            const double offset =
                is_wanted ? std::fabs(l.volume.at(p) -
                                      (l.volume.at(node.end0) + l.volume.at(node.end1)) / 2)
                          : 0;
            CHECK(static_cast<double>(found) == Approx(offset).margin(1e-6));
        }
    }
    CHECK_THROWS_AS(export_computed_field(*l.store, folder / "x.raw",
                                          {field_named("lp:1"), 0, false, 1}, silent_progress()),
                    Error);
}
