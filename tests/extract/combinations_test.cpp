// Options that cannot be combined: the manual lists exactly the pairs that the code refuses.
#include "query/extract/combinations.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/test_support.h"

namespace isonest::detail {
namespace {

/// The first two cells of a row of the manual's table; the rest is prose.
std::string pairs_of(const Combination& row) {
    std::string with;
    for (std::size_t i = 0; i < row.with.size(); ++i) {
        if (row.with[i]) {
            with += fmt::format("{}{}", with.empty() ? "" : "; ", name_of(static_cast<Feature>(i)));
        }
    }
    return fmt::format("\n| {} | {} | ", name_of(row.feature), with);
}

Features both(Feature a, Feature b) {
    Features features;
    features.set(static_cast<std::size_t>(a));
    features.set(static_cast<std::size_t>(b));
    return features;
}

}  // namespace

TEST_CASE("the manual lists exactly the pairs that the code refuses") {
    const auto root = std::filesystem::path(ISONEST_FUZZ_CORPUS) / ".." / ".." / "..";
    std::ifstream file(root / "tools" / "MANUAL.md");
    std::stringstream manual;
    manual << file.rdbuf();
    const std::string text = manual.str();
    const std::size_t begin = text.find("\n### What cannot be combined\n");
    REQUIRE(begin != std::string::npos);
    const std::string section = text.substr(begin, text.find("\n## ", begin) - begin);
    for (const Combination& row : refused_combinations()) {
        INFO(pairs_of(row));
        CHECK(section.find(pairs_of(row)) != std::string::npos);
    }
    std::size_t rows = 0;
    for (std::size_t at = section.find("\n| "); at != std::string::npos;
         at = section.find("\n| ", at + 1)) {
        ++rows;
    }
    CHECK(rows == refused_combinations().size() + 1);  // plus the head of the table
}

TEST_CASE(
    "each row of the table refuses its pair with its reason, and pairs without a row are "
    "accepted") {
    for (std::size_t a = 0; a < Features{}.size(); ++a) {
        for (std::size_t b = a + 1; b < Features{}.size(); ++b) {
            const auto first = static_cast<Feature>(a);
            const auto second = static_cast<Feature>(b);
            const Combination* found = nullptr;
            for (const Combination& row : refused_combinations()) {
                if ((row.feature == first && row.with[b]) ||
                    (row.feature == second && row.with[a])) {
                    CHECK(found == nullptr);  // at most one row for each pair
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
            CHECK(problem.ends_with(found != nullptr ? found->reason : ""));
            CHECK(problem.empty() == (found == nullptr));
            if (found != nullptr) {
                CHECK(problem.find(name_of(first)) != std::string::npos);
                CHECK(problem.find(name_of(second)) != std::string::npos);
            }
        }
    }
}

TEST_CASE("a query has the features that its members ask for") {
    const auto features = [](const SurfaceQuery& query, Feature feature) {
        return features_of(query).test(static_cast<std::size_t>(feature));
    };
    SurfaceQuery query;
    CHECK(features_of(query).count() == 3);
    CHECK(features(query, Feature::hexahedra));
    CHECK(features(query, Feature::no_distance));
    CHECK(features(query, Feature::open));
    query.stop = FieldThreshold{};
    CHECK(features(query, Feature::threshold));
    CHECK(features(query, Feature::error));
    query.stop = TriangleBudgetByError{5, ErrorIndicator::estimate};
    CHECK(features(query, Feature::estimate));
    CHECK(features(query, Feature::error));
    CHECK_FALSE(features(query, Feature::simplified_error));
    query.stop = TriangleBudgetByError{5};
    CHECK(features(query, Feature::simplified_error));
    query.effort = Effort::none;
    CHECK_FALSE(features(query, Feature::simplified_error));
    query.effort = Effort::best;
    query.stop = ErrorBound{0.1, false, ErrorIndicator::estimate};
    CHECK(features(query, Feature::simplified_error));
    CHECK(features(query, Feature::error));
    CHECK(features(query, Feature::estimate));
    query.effort.reset();
    CHECK_FALSE(features(query, Feature::simplified_error));
    query.stop = ErrorBound{0.1};
    CHECK(features(query, Feature::simplified_error));
    query.camera.emplace();
    CHECK_FALSE(features(query, Feature::simplified_error));
    query.camera.reset();
    query.stop = DistanceBound{1};
    CHECK(features(query, Feature::distance));
    query.effort = Effort::none;
    CHECK(features(query, Feature::nested_distance));
    CHECK_FALSE(features(query, Feature::distance));
    query.effort.reset();
    query.stop = TriangleBudgetByDistance{5};
    CHECK(features(query, Feature::triangles));
    CHECK(features(query, Feature::distance));
    CHECK_FALSE(features(query, Feature::no_distance));
    CHECK_FALSE(features(query, Feature::fast));
    query.effort = Effort::fast;
    for (const SurfaceStop& stop :
         {SurfaceStop(TriangleBudgetByDistance{5}), SurfaceStop(DistanceBound{5})}) {
        query.stop = stop;
        CHECK(features(query, Feature::fast));
        CHECK(features(query, Feature::distance));
    }
    query.stages.components = ComponentChoice{.min_volume = 1};
    CHECK(features(query, Feature::components));
    CHECK(features(query, Feature::min_volume));
    query.grid = {Cells::hexahedra, VertexPlace::exact, {}, BackfaceCulling{}};
    query.camera.emplace();
    query.stages.close = Outside::above;
    query.analysis.emplace();
    query.volume_interval = true;
    CHECK_FALSE(features(query, Feature::open));
    CHECK_FALSE(features(query, Feature::coarse_hexahedra));
    for (const Feature feature :
         {Feature::hexahedra, Feature::exact_vertices, Feature::culling, Feature::place,
          Feature::closing, Feature::analysis, Feature::volume_interval}) {
        CHECK(features(query, feature));
    }
    query.stop = ErrorBound{0.1};
    query.effort = Effort::none;
    CHECK(features(query, Feature::coarse_hexahedra));
    query.stop = ErrorBound{};
    CHECK_FALSE(features(query, Feature::coarse_hexahedra));
    query.stop = ErrorBound{0.1};
    query.effort = Effort::best;
    CHECK_FALSE(features(query, Feature::coarse_hexahedra));
}

TEST_CASE(
    "a label's surface accepts the same features as others, except those that labels do not "
    "support") {
    SurfaceQuery query;
    query.stop = DistanceBound{2, true};
    query.effort = Effort::fast;
    query.box = WorldBox{{0, 0, 0}, {1, 1, 1}};
    query.stages.close = Outside::below;
    query.attributes.normals = true;
    query.grid.cells = Cells::hexahedra;
    const LabelQuery label = label_query(query, {3});
    CHECK(label.cells == Cells::hexahedra);
    CHECK(label.label.id == 3);
    CHECK(std::get<DistanceBound>(label.stop.value()).voxels);
    CHECK(label.effort == Effort::fast);
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
