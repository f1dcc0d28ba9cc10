// The study of hexahedra and quadrilaterals against a list of all cells of the adaptive grid.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <map>

#include <isonest/error.h>

#include "query/study/study.h"
#include "tests/cell_oracle.h"
#include "tests/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

struct Leaf {
    Int3 low;
    Int3 high;  ///< alike along flat axes

    [[nodiscard]] bool holds(const Int3& p) const { return max(p, low) == p && min(p, high) == p; }
    [[nodiscard]] bool has_corner(const Int3& p) const {
        return (p.x == low.x || p.x == high.x) && (p.y == low.y || p.y == high.y) &&
               (p.z == low.z || p.z == high.z);
    }
};

struct Measured {
    std::uint64_t visited = 0;
    std::uint64_t leaves = 0;
    std::uint64_t nodes = 0;
    double l1 = 0;
    double l2 = 0;
    double linf = 0;
    double jump = 0;  ///< largest difference of what two cells give at a node
    std::size_t hanging = 0;
};

/// Refines by the oracle's numbers; finds hanging nodes by looking at all leaves.
template <class T>
class CellGrid {
  public:
    CellGrid(const FunctionVolume<T>& volume, const std::vector<CellNumbers>& numbers, bool plus,
             double threshold)
        : volume_(volume), numbers_(numbers), plus_(plus), threshold_(threshold) {
        visit(static_cast<int>(numbers.size()), {0, 0, 0});
    }

    Measured measure() {
        std::map<std::array<std::int64_t, 3>, bool> corners;
        for (const Leaf& leaf : leaves_) {
            for (std::int64_t c = 0; c < 8; ++c) {
                const Int3 p = corner(leaf, c);
                corners[{p.x, p.y, p.z}] = true;
            }
        }
        for (const auto& entry : corners) {
            const Int3 p{entry.first[0], entry.first[1], entry.first[2]};
            if (max(p, volume_.nodes() - Int3{1, 1, 1}) != volume_.nodes() - Int3{1, 1, 1}) {
                continue;
            }
            (hangs_on(p) == nullptr ? measured_.nodes : measured_.hanging) += 1;
        }
        const Int3 n = volume_.nodes();
        double weights = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = n.unlinear(i);
            const double u = volume_.at(p);
            if (std::isnan(u)) {
                continue;
            }
            double weight = 1;
            for (int axis = 0; axis < 3; ++axis) {
                const bool border = p[axis] == 0 || p[axis] == n[axis] - 1;
                weight *= n[axis] > 1 && border ? 0.5 : 1;
            }
            double least = std::numeric_limits<double>::infinity();
            double most = -least;
            for (const Leaf& leaf : leaves_) {
                if (leaf.holds(p)) {
                    least = std::min(least, in_leaf(leaf, p));
                    most = std::max(most, in_leaf(leaf, p));
                }
            }
            measured_.jump = std::max(measured_.jump, most - least);
            const double d = std::fabs(most - u);
            weights += weight;
            measured_.l1 += weight * d;
            measured_.l2 += weight * d * d;
            measured_.linf = std::max(measured_.linf, d);
        }
        measured_.l1 /= weights;
        measured_.l2 = std::sqrt(measured_.l2 / weights);
        measured_.leaves = leaves_.size();
        return measured_;
    }

  private:
    void visit(int level, const Int3& cell) {
        ++measured_.visited;
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 n = volume_.nodes();
        const Int3 one{n.x > 1 ? 1 : 0, n.y > 1 ? 1 : 0, n.z > 1 ? 1 : 0};
        if (level > 0) {
            const CellNumbers& of = numbers_[static_cast<std::size_t>(level - 1)];
            const auto which = static_cast<std::size_t>(of.cells.linear(cell));
            if ((plus_ ? of.plus : of.bar)[which] >= threshold_) {
                for (std::int64_t c = 0; c < 8; ++c) {
                    const Int3 o = Int3{2, 2, 2}.unlinear(c);
                    const Int3 child = cell * 2 + o;
                    const Int3 begin = child * (edge / 2);
                    if (max(o, one) == one && (n.x == 1 || begin.x < n.x - 1) &&
                        (n.y == 1 || begin.y < n.y - 1) && (n.z == 1 || begin.z < n.z - 1)) {
                        visit(level - 1, child);
                    }
                }
                return;
            }
        }
        leaves_.push_back({cell * edge, (cell + one) * edge});
    }
    static Int3 corner(const Leaf& leaf, std::int64_t c) {
        const Int3 o = Int3{2, 2, 2}.unlinear(c);
        return {o.x != 0 ? leaf.high.x : leaf.low.x, o.y != 0 ? leaf.high.y : leaf.low.y,
                o.z != 0 ? leaf.high.z : leaf.low.z};
    }
    const Leaf* hangs_on(const Int3& p) const {
        for (const Leaf& leaf : leaves_) {
            if (leaf.holds(p) && !leaf.has_corner(p)) {
                return &leaf;
            }
        }
        return nullptr;
    }
    double at_corner(const Int3& p) {
        const auto [found, is_new] = values_.try_emplace({p.x, p.y, p.z}, 0.0);
        if (is_new) {
            const Leaf* const larger = hangs_on(p);
            const double value = larger != nullptr ? in_leaf(*larger, p) : volume_.at(p);
            found->second = value;
        }
        return values_[{p.x, p.y, p.z}];
    }
    double in_leaf(const Leaf& leaf, const Int3& p) {
        double sum = 0;
        for (std::int64_t c = 0; c < 8; ++c) {
            const Int3 o = Int3{2, 2, 2}.unlinear(c);
            double weight = 1;
            for (int axis = 0; axis < 3; ++axis) {
                const std::int64_t edge = leaf.high[axis] - leaf.low[axis];
                const double t = edge == 0 ? 0
                                           : static_cast<double>(p[axis] - leaf.low[axis]) /
                                                 static_cast<double>(edge);
                weight *= o[axis] != 0 ? t : 1 - t;
            }
            sum += weight > 0 ? weight * at_corner(corner(leaf, c)) : 0;
        }
        return sum;
    }

    const FunctionVolume<T>& volume_;
    const std::vector<CellNumbers>& numbers_;
    bool plus_;
    double threshold_;
    std::vector<Leaf> leaves_;
    std::map<std::array<std::int64_t, 3>, double> values_;
    Measured measured_;
};

/// Smooth but for one corner: cells of all sizes.
double graded(const Int3& p) {
    const double far =
        std::hypot(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z));
    return 0.002 * static_cast<double>(p.x * p.y + p.z * p.z) + noise(p) * std::exp(-far / 3);
}

Study study_of(FunctionVolume<double>& volume, const StudyOptions& options, int chunk) {
    const TemporaryFolder folder;
    PreprocessOptions how = with_chunk(chunk, true);
    how.fields = {Field::deviation_bar, Field::hex_linf, Field::hex_deviation};
    make_store(volume, folder / "s", how);
    return study(StoreReader(folder / "s"), options, silent_progress());
}

}  // namespace

TEST_CASE("the study of cells counts and measures what a list of all cells gives") {
    std::size_t hanging = 0;
    for (const Int3& n : {Int3{9, 12, 6}, Int3{11, 5, 13}, Int3{21, 26, 1}, Int3{1, 17, 30},
                          Int3{33, 1, 7}, Int3{3, 3, 3}}) {
        for (const bool holes : {false, true}) {
            CAPTURE(n.x, n.y, n.z, holes);
            FunctionVolume<double> volume(n, [&](const Int3& p) {
                return holes && p == n - Int3{1, 1, 1} ? std::numeric_limits<double>::quiet_NaN()
                                                       : graded(p);
            });
            const std::vector<CellNumbers> numbers = cell_numbers_by_loops(volume, Lattice(n));
            StudyOptions options;
            options.fields = {Field::hex_linf, Field::hex_deviation, Field::deviation_bar};
            options.steps = 6;
            options.least = 1e-2;
            const Study s = study_of(volume, options, 8);
            REQUIRE(s.rows.size() == 18);
            double range = 0;
            for (std::int64_t i = 0; i < n.product(); ++i) {
                for (std::int64_t j = 0; j < n.product(); ++j) {
                    range = std::fmax(range, volume.at(n.unlinear(i)) - volume.at(n.unlinear(j)));
                }
            }
            const Int3 cells = Lattice(n).elements_at(0);
            CHECK(s.all_cells == static_cast<std::uint64_t>(cells.product()));
            for (std::size_t r = 0; r < 12; ++r) {
                const StudyRow& row = s.rows[r];
                const bool plus = r >= 6;
                CHECK(std::get<Field>(row.field) ==
                      (plus ? Field::hex_deviation : Field::hex_linf));
                double largest = 0;
                for (const CellNumbers& of : numbers) {
                    for (const double number : plus ? of.plus : of.bar) {
                        largest = std::isfinite(number) ? std::max(largest, number) : largest;
                    }
                }
                if (largest == 0) {
                    continue;  // all cells of a finite number are without an error
                }
                // A little lower, because stored numbers are rounded.
                CellGrid grid(volume, numbers, plus, row.threshold * largest * (1 - 1e-6));
                const Measured m = grid.measure();
                CAPTURE(row.threshold, plus);
                CHECK(row.visited == m.visited);
                CHECK(row.leaves == m.leaves);
                CHECK(row.nodes == m.nodes);
                CHECK(row.norms.l1 * range == Approx(m.l1).margin(1e-12));
                CHECK(row.norms.l2 * range == Approx(m.l2).margin(1e-12));
                CHECK(row.norms.linf * range == Approx(m.linf).margin(1e-12));
                CHECK(m.jump <= 1e-12);
                hanging += m.hanging;
                if (plus) {  // a bound, in each node
                    CHECK(row.norms.linf * range <= row.threshold * largest * (1 + 1e-6));
                }
            }
        }
    }
    CHECK(hanging > 100);
}

TEST_CASE("the study of cells is the same for any threads, memory and chunks") {
    FunctionVolume<double> volume({25, 18, 21}, graded);
    StudyOptions options;
    options.fields = {Field::hex_deviation, Field::deviation_bar};
    options.steps = 5;
    options.iso = 0.5;
    const auto text = [&](int threads, std::uint64_t memory, int chunk) {
        options.threads = threads;
        options.memory = memory;
        std::string all;
        for (const StudyRow& row : study_of(volume, options, chunk).rows) {
            all += fmt::format("{} {} {} {} {} {} {} {}\n", row.visited, row.leaves, row.nodes,
                               row.norms.l1, row.norms.l2, row.norms.linf, row.iso_visited,
                               row.iso_leaves);
            CHECK(row.iso_visited <= row.visited);
            CHECK(row.iso_leaves <= row.leaves);
        }
        return all;
    };
    const std::string one = text(1, std::uint64_t{1} << 30U, 8);
    CHECK(text(2, std::uint64_t{1} << 30U, 8) == one);
    CHECK(text(2, std::uint64_t{1} << 26U, 8) == one);
    CHECK(text(2, std::uint64_t{1} << 30U, 16) == one);
}

TEST_CASE("a study refuses what it cannot say of cells") {
    FunctionVolume<double> volume({9, 9, 9}, graded);
    FunctionVolume<double> plane({9, 9, 1}, graded);
    const auto refused = [](FunctionVolume<double>& of,
                            const std::function<void(StudyOptions&)>& ask, const char* why) {
        StudyOptions options;
        options.fields = {Field::hex_linf};
        ask(options);
        try {
            study_of(of, options, 8);
            FAIL("not refused");
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            CHECK_THAT(error.what(), Catch::Contains(why));
        }
    };
    refused(
        volume,
        [](StudyOptions& o) {
            o.plane = WorldPlane{{0, 0, 1}, 4};
        },
        "slice");
    refused(
        volume, [](StudyOptions& o) { o.power = 2; }, "gradient");
    refused(
        volume, [](StudyOptions& o) { o.graphs = true; }, "graphs");
    refused(
        plane, [](StudyOptions& o) { o.iso = 0.3; }, "isolines");
}
