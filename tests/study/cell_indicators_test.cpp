// Computed indicators of cells, compared with the store's and with loops over the children's
// corners.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/study/computed_field.h"
#include "query/study/study.h"
#include "store/container/chunk_cache.h"
#include "tests/support/loaded_lattice.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kSpacing{1, 0.5, 2};

PreprocessOptions with_cell_fields() {
    PreprocessOptions options = with_chunk(8, true);
    options.fields = {Field::deviation_bar, Field::hex_linf, Field::hex_deviation};
    return options;
}

struct Loaded : LoadedLattice {
    Loaded(const Int3& n, const std::function<double(const Int3&)>& f)
        : LoadedLattice(n, f, kSpacing, with_cell_fields()) {}
};

ComputedField field_named(const std::string& name) {
    const std::optional<ComputedField> field = computed_field_from_name(name);
    REQUIRE(field);
    return *field;
}

/// U_delta at a point of a cell of a level: node `at`, in half edges from the cell's low corner.
double offset(const Loaded& l, int level, const Int3& cell, const Int3& at) {
    const Int3 last = l.volume.nodes() - Int3{1, 1, 1};
    const std::int64_t half = std::int64_t{1} << (level - 1);
    double linear = 0;
    for (std::int64_t c = 0; c < 8; ++c) {
        const Int3 o = Int3{2, 2, 2}.unlinear(c);
        double weight = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const double t = static_cast<double>(at[axis]) / 2;
            weight *= o[axis] != 0 ? t : 1 - t;
        }
        linear += weight == 0 ? 0 : weight * l.volume.at(min((cell + o) * (2 * half), last));
    }
    return l.volume.at(min(cell * (2 * half) + at * half, last)) - linear;
}

/// The norm over the cell, as a sum over the corners of all its children.
double by_children(const Loaded& l, int level, const Int3& cell, bool gradient, double power) {
    const Int3 axes = min(l.volume.nodes() - Int3{1, 1, 1}, {1, 1, 1});
    const double half = std::ldexp(1.0, level - 1);
    double sum = 0;
    double most = 0;
    for (std::int64_t child = 0; child < 8; ++child) {
        for (std::int64_t corner = 0; corner < 8; ++corner) {
            const Int3 a = Int3{2, 2, 2}.unlinear(child);
            const Int3 b = Int3{2, 2, 2}.unlinear(corner);
            if (min(a, axes) != a || min(b, axes) != b) {
                continue;
            }
            double weight = 1;
            double square = 0;
            for (int axis = 0; axis < 3; ++axis) {
                if (axes[axis] == 0) {
                    continue;
                }
                const double edge = half * kSpacing[static_cast<std::size_t>(axis)];
                weight *= edge / 2;
                Int3 other = b;
                other[axis] = 1 - b[axis];
                const double slope =
                    (offset(l, level, cell, a + other) - offset(l, level, cell, a + b)) / edge;
                square += slope * slope;
            }
            const double size =
                gradient ? std::sqrt(square) : std::fabs(offset(l, level, cell, a + b));
            sum += weight * std::pow(size, power);
            most = std::max(most, size);
        }
    }
    return std::isinf(power) ? most : std::pow(sum, 1 / power);
}

}  // namespace

TEST_CASE("norms of cells are sums over their children, saturated over the finer cells around") {
    for (const Int3& n : {Int3{9, 9, 9}, {6, 11, 4}, {12, 1, 9}, {1, 21, 1}}) {
        Loaded l(n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
        const Lattice& lattice = l.whole->lattice();
        for (const bool gradient : {false, true}) {
            for (const std::string power : {"1", "2.5", "inf"}) {
                for (const std::string saturation : {"", "_bar", "_plus"}) {
                    const std::string name =
                        (gradient ? "hex_grad_lp:" : "hex_lp:") + power + saturation;
                    CAPTURE(n.x, n.y, n.z, name);
                    const ComputedField field = field_named(name);
                    CHECK(name_of(field) == name);
                    const double largest =
                        compute_indicator(*l.whole, field, kSpacing, silent_progress());
                    double most = 0;
                    std::vector<double> finer;
                    Int3 finer_cells;
                    for (int level = 1; level <= lattice.top(); ++level) {
                        const Int3 cells = lattice.elements_at(level);
                        std::vector<double> own;
                        for (std::int64_t i = 0; i < cells.product(); ++i) {
                            const Int3 cell = cells.unlinear(i);
                            double eta = by_children(l, level, cell, gradient, field.power);
                            double below = 0;
                            for (std::int64_t k = 0; k < finer_cells.product(); ++k) {
                                const Int3 c = finer_cells.unlinear(k);
                                const Int3 low = max(c, cell * 2);
                                const Int3 high =
                                    min(c + Int3{1, 1, 1}, (cell + Int3{1, 1, 1}) * 2);
                                if (max(low, high) == high) {
                                    below = std::max(below, finer[static_cast<std::size_t>(k)]);
                                }
                            }
                            eta = saturation == "_bar"    ? std::max(eta, below)
                                  : saturation == "_plus" ? eta + below
                                                          : eta;
                            own.push_back(eta);
                            most = std::max(most, eta);
                            CHECK(static_cast<double>(l.whole->indicator(lattice.centre_of(
                                      level, cell))) == Approx(eta).epsilon(1e-5).margin(1e-7));
                        }
                        finer = own;
                        finer_cells = cells;
                    }
                    CHECK(largest == Approx(most).epsilon(1e-5));
                }
            }
        }
    }
}

TEST_CASE("the largest offset of cells is the store's") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{20, 13, 1}}) {
        Loaded l(n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
        WholeLattice stored(l.store->layout());
        stored.load_values(*l.cache);
        for (const Field field : {Field::hex_linf, Field::hex_deviation}) {
            const bool bar = field == Field::hex_linf;
            const double expected = load_cell_numbers(stored, *l.cache, field, silent_progress());
            const double largest =
                compute_indicator(*l.whole, field_named(bar ? "hex_lp:inf_bar" : "hex_lp:inf_plus"),
                                  kSpacing, silent_progress());
            CHECK(largest == Approx(expected).epsilon(1e-5));
            for (int level = 1; level <= l.whole->lattice().top(); ++level) {
                const Int3 cells = l.whole->lattice().elements_at(level);
                for (std::int64_t i = 0; i < cells.product(); ++i) {
                    const Int3 p = l.whole->lattice().centre_of(level, cells.unlinear(i));
                    REQUIRE(static_cast<double>(l.whole->indicator(p)) ==
                            Approx(static_cast<double>(stored.indicator(p))).epsilon(1e-5));
                }
            }
        }
    }
}

TEST_CASE("a computed indicator of cells is studied like the store's") {
    Loaded l({17, 17, 17}, [](const Int3& p) { return smooth(p); });
    StudyOptions options;
    options.fields = {Field::hex_linf, field_named("hex_lp:inf_bar"), field_named("hex_lp:2_bar")};
    options.steps = 6;
    const Study s = study(*l.store, options, silent_progress());
    REQUIRE(s.rows.size() == 18);
    for (std::size_t i = 0; i < 6; ++i) {
        CHECK(static_cast<double>(s.rows[i].leaves) ==
              Approx(static_cast<double>(s.rows[i + 6].leaves)).epsilon(0.02));
        CHECK(s.rows[i].norms.l2 == Approx(s.rows[i + 6].norms.l2).epsilon(0.02));
    }
    CHECK(s.rows[17].leaves > s.rows[12].leaves);
    options.iso = 0.5;
    CHECK_THROWS_AS(study(*l.store, options, silent_progress()), Error);
    options.iso = {};
    options.power = 2;
    CHECK_THROWS_AS(study(*l.store, options, silent_progress()), Error);
    const TemporaryFolder folder;
    CHECK_THROWS_AS(export_computed_field(*l.store, folder / "x.raw",
                                          {field_named("hex_lp:2"), 0, true}, silent_progress()),
                    Error);
}

TEST_CASE("a computed indicator of cells is infinite at and above missing values") {
    Loaded l({9, 9, 9}, [](const Int3& p) {
        return p == Int3{3, 4, 5} ? std::numeric_limits<double>::quiet_NaN() : smooth(p);
    });
    const double largest =
        compute_indicator(*l.whole, field_named("hex_lp:2_bar"), kSpacing, silent_progress());
    CHECK(std::isfinite(largest));
    CHECK(std::isinf(l.whole->indicator({3, 3, 5})));
    CHECK(std::isinf(l.whole->indicator({4, 4, 4})));
    CHECK(std::isfinite(l.whole->indicator({1, 1, 1})));
}
