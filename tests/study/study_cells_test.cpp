// The study of hexahedra and quadrilaterals compared with a list of all cells of the adaptive grid.
#include <fmt/format.h>

#include <catch2/catch.hpp>

#include <isonest/error.h>

#include "query/study/study.h"
#include "tests/support/cell_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Smooth except in one corner: cells of all sizes.
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

TEST_CASE("the study of cells gives the counts and errors of a list of all cells") {
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
                    continue;  // all cells with a finite number have no error
                }
                // Slightly lower, because stored numbers are rounded.
                CellGridByList grid(volume, numbers, plus, row.threshold * largest * (1 - 1e-6));
                const CellGridByList<double>::Measured m = grid.measure();
                CAPTURE(row.threshold, plus);
                CHECK(row.visited == m.visited);
                CHECK(row.leaves == m.leaves);
                CHECK(row.nodes == m.nodes);
                CHECK(row.norms.l1 * range == Approx(m.l1).margin(1e-12));
                CHECK(row.norms.l2 * range == Approx(m.l2).margin(1e-12));
                CHECK(row.norms.linf * range == Approx(m.linf).margin(1e-12));
                CHECK(m.jump <= 1e-12);
                hanging += m.hanging;
                if (plus) {  // a bound at each node
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

TEST_CASE("a study refuses what it does not support for cells") {
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
