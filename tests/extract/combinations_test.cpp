// What does not go together: the manual shows the table that the code refuses by.
#include "query/extract/combinations.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/test_support.h"

namespace isonest::detail {
namespace {

/// A line for each run of rows with one reason.
std::string table() {
    std::string text = "| this | goes not with | because |\n|---|---|---|\n";
    const auto rows = refused_combinations();
    for (std::size_t i = 0; i < rows.size();) {
        std::string with;
        std::size_t j = i;
        for (; j < rows.size() && rows[j].wish == rows[i].wish &&
               std::string(rows[j].reason) == rows[i].reason;
             ++j) {
            with += fmt::format("{}{}", with.empty() ? "" : "; ", name_of(rows[j].with));
        }
        text += fmt::format("| {} | {} | {} |\n", name_of(rows[i].wish), with, rows[i].reason);
        i = j;
    }
    return text;
}

Wishes both(Wish a, Wish b) {
    Wishes wishes;
    wishes.set(static_cast<std::size_t>(a));
    wishes.set(static_cast<std::size_t>(b));
    return wishes;
}

}  // namespace

TEST_CASE("the manual shows what does not go together as the code refuses it") {
    const auto root = std::filesystem::path(ISONEST_FUZZ_CORPUS) / ".." / ".." / "..";
    std::ifstream file(root / "tools" / "MANUAL.md");
    std::stringstream manual;
    manual << file.rdbuf();
    INFO("the table of the code:\n" << table());
    CHECK(manual.str().find("\n\n" + table() + "\n") != std::string::npos);
}

TEST_CASE("each row of the table refuses, with its reason, and no pair without a row is refused") {
    for (std::size_t a = 0; a < Wishes{}.size(); ++a) {
        for (std::size_t b = a + 1; b < Wishes{}.size(); ++b) {
            const auto first = static_cast<Wish>(a);
            const auto second = static_cast<Wish>(b);
            const Combination* found = nullptr;
            for (const Combination& row : refused_combinations()) {
                if ((row.wish == first && row.with == second) ||
                    (row.wish == second && row.with == first)) {
                    CHECK(found == nullptr);  // one row for each pair
                    found = &row;
                }
            }
            CAPTURE(name_of(first), name_of(second));
            std::string problem;
            try {
                require_combination(both(first, second), "s.isonest");
            } catch (const Error& e) {
                CHECK(e.kind() == ErrorKind::invalid_argument);
                problem = e.problem();
            }
            CHECK(problem == (found != nullptr ? found->reason : ""));
        }
    }
}

TEST_CASE("a query wishes what its members say") {
    const auto wishes = [](const SurfaceQuery& query, Wish wish) {
        return wishes_of(query).test(static_cast<std::size_t>(wish));
    };
    SurfaceQuery query;
    CHECK(wishes_of(query).count() == 2);
    CHECK(wishes(query, Wish::no_distance));
    CHECK(wishes(query, Wish::open));
    query.stop = FieldThreshold{};
    CHECK(wishes(query, Wish::threshold));
    CHECK(wishes(query, Wish::error));
    query.stop = ErrorBudget{5, Guarantee::estimate};
    CHECK(wishes(query, Wish::estimate));
    CHECK(wishes(query, Wish::error));
    query.stop = SimplifiedErrorBound{{0.1, false, Guarantee::estimate}};
    CHECK(wishes(query, Wish::simplified_error));
    CHECK(wishes(query, Wish::error));
    CHECK(wishes(query, Wish::estimate));
    query.stop = TriangleBudget{5};
    CHECK(wishes(query, Wish::triangles));
    CHECK(wishes(query, Wish::distance));
    CHECK_FALSE(wishes(query, Wish::no_distance));
    CHECK_FALSE(wishes(query, Wish::fast));
    for (const SurfaceStop& stop : {SurfaceStop(TriangleBudget{5, {}, Effort::fast}),
                                    SurfaceStop(DistanceBound{5, false, Effort::fast})}) {
        query.stop = stop;
        CHECK(wishes(query, Wish::fast));
        CHECK(wishes(query, Wish::distance));
    }
    query.stages.components = ComponentChoice{.least_volume = 1};
    CHECK(wishes(query, Wish::components));
    CHECK(wishes(query, Wish::least_volume));
    query.grid = {Cells::hexahedra, VertexPlace::exact, {}, BackfaceCulling{}};
    query.camera.emplace();
    query.stages.close = Outside::above;
    query.analysis.emplace();
    query.volume_interval = true;
    CHECK_FALSE(wishes(query, Wish::open));
    CHECK_FALSE(wishes(query, Wish::coarse_hexahedra));
    for (const Wish wish : {Wish::hexahedra, Wish::exact_vertices, Wish::culling, Wish::place,
                            Wish::closing, Wish::analysis, Wish::volume_interval}) {
        CHECK(wishes(query, wish));
    }
    query.stop = ErrorBound{0.1};
    CHECK(wishes(query, Wish::coarse_hexahedra));
    query.stop = ErrorBound{};
    CHECK_FALSE(wishes(query, Wish::coarse_hexahedra));
}

TEST_CASE("a label's surface is asked for as another, without what labels have not") {
    SurfaceQuery query;
    query.stop = DistanceBound{2, true, Effort::fast};
    query.box = WorldBox{{0, 0, 0}, {1, 1, 1}};
    query.stages.close = Outside::below;
    query.attributes.normals = true;
    query.grid.cells = Cells::hexahedra;
    const LabelQuery label = label_query(query, {3});
    CHECK(label.cells == Cells::hexahedra);
    CHECK(label.label.id == 3);
    CHECK(std::get<DistanceBound>(label.stop.value()).voxels);
    CHECK(std::get<DistanceBound>(label.stop.value()).effort == Effort::fast);
    CHECK(label.box);
    CHECK(label.stages.close);
    CHECK(label.attributes.normals);
    query.stop = ErrorBound{};
    CHECK_FALSE(label_query(query, {3}).stop);
    query.stop = ErrorBound{1};
    CHECK_THROWS_AS(label_query(query, {3}), Error);
    query.stop = {};
    query.focus.emplace();
    CHECK_THROWS_AS(label_query(query, {3}), Error);
}

}  // namespace isonest::detail
