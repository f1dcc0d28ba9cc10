// Interfaces of labels in C++: what a sink receives, in any order, and what is refused.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <map>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail::test;

namespace {

/// A store of labels 1 ... 6 in regions that extend over several pieces.
struct Lumps {
    Lumps() : volume({70, 41, 19}, [](const Int3& p) { return label_at(p); }) {
        make_store(volume, folder / "s", with_chunk(8));
        store.emplace(folder / "s");
        labels = find_labels(*store);
        query.smooth = LabelSmoothing{5};
        query.stages.close = Outside::below;
    }
    static std::uint8_t label_at(const Int3& p) {
        const double wave = smooth(p) + 0.05 * noise(p);
        return static_cast<std::uint8_t>(1 + std::clamp(static_cast<int>(3 + 3 * wave), 0, 5));
    }
    TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume;
    std::optional<Store> store;
    std::vector<Label> labels;
    LabelQuery query;
};

}  // namespace

TEST_CASE("interfaces in order and in any order are the same, and batches repeat their corners") {
    const Lumps lumps;
    REQUIRE(lumps.labels.size() > 3);
    MeshCollector whole;
    const ExtractReport report = extract_interfaces(*lumps.store, lumps.labels, lumps.query, whole);
    REQUIRE(whole.triangles.size() > 20000);
    CHECK(whole.sides.size() == whole.triangles.size());
    CHECK(report.triangles == whole.triangles.size());
    CHECK(report.vertices == whole.vertices.size());
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    bool right = true;
    CallbackSink in_order(
        [&](const VertexBatch& batch) {
            right = right && batch.first == vertices && triangles == 0 &&
                    std::equal(batch.positions.begin(), batch.positions.end(),
                               whole.vertices.begin() + static_cast<std::ptrdiff_t>(vertices));
            vertices += batch.positions.size();
        },
        [&](const ElementBatch& batch) {
            right = right && batch.first == triangles &&
                    batch.sides.size() == batch.corners.size() &&
                    batch.corners.size() <= MeshSink::kMaxRows;
            for (std::size_t i = 0; right && i < batch.corners.size(); ++i, ++triangles) {
                right = batch.sides[i] == whole.sides[triangles];
                for (std::size_t k = 0; k < 3; ++k) {
                    right = right && batch.corners[i][k] == whole.triangles[triangles][k] &&
                            batch.nearby.positions[batch.nearby_corners[i][k]] ==
                                whole.vertices[batch.corners[i][k]];
                }
            }
        });
    extract_interfaces(*lumps.store, lumps.labels, lumps.query, in_order, {}, {.threads = 3});
    CHECK(right);
    CHECK(vertices == whole.vertices.size());
    CHECK(triangles == whole.triangles.size());
    CHECK(in_order.layout().has_sides);
    CHECK(in_order.layout().sides_range == std::array<std::int64_t, 2>{-1, lumps.labels.back().id});
}

TEST_CASE(
    "each pair of labels is reported once, with the area of its triangles, and after the mesh") {
    const Lumps lumps;
    MeshCollector mesh;
    std::map<std::pair<std::int64_t, std::int64_t>, double> told;
    double sum = 0;
    const ExtractReport report = extract_interfaces(
        *lumps.store, lumps.labels, lumps.query, mesh, [&](const LabelInterface& i) {
            CHECK(!mesh.triangles.empty());
            CHECK(told.emplace(std::pair(i.behind, i.in_front), i.area).second);
            sum += i.area;
        });
    REQUIRE(report.interfaces);
    CHECK(report.interfaces->outside == -1);
    CHECK(report.interfaces->interfaces == told.size());
    std::map<std::pair<std::int64_t, std::int64_t>, bool> there;
    for (const auto& [behind, in_front] : mesh.sides) {
        there[{behind, in_front}] = true;
    }
    CHECK(told.size() == there.size());
    for (const auto& [pair, is_there] : there) {
        CHECK(told.count(pair) == 1);
    }
    CHECK(report.measures->area == Approx(sum).epsilon(1e-9));
    CHECK_FALSE(report.measures->volume);
    CHECK(report.smooth->passes == 5);
    CHECK(report.smooth->bound > 0);
    // The bound holds for all labels: it is the largest of their bounds.
    double largest = 0;
    std::uint64_t twice = 0;
    extract_labels(
        *lumps.store, lumps.labels, lumps.query,
        [](const Label&) { return std::make_unique<MeshCollector>(); },
        [&](std::size_t, const ExtractReport& r) {
            largest = std::max(largest, r.smooth->bound);
            twice += r.triangles;
        },
        {.threads = 1});
    CHECK(report.smooth->bound == largest);
    const auto caps = std::count_if(mesh.sides.begin(), mesh.sides.end(),
                                    [](const auto& sides) { return sides[1] == -1; });
    CHECK(twice == 2 * mesh.triangles.size() - static_cast<std::uint64_t>(caps));
}

TEST_CASE(
    "the order of the requested labels does not change the interfaces, and an empty list gives "
    "none") {
    const Lumps lumps;
    MeshCollector mesh;
    extract_interfaces(*lumps.store, lumps.labels, lumps.query, mesh);
    const std::vector<Label> backwards(lumps.labels.rbegin(), lumps.labels.rend());
    MeshCollector again;
    extract_interfaces(*lumps.store, backwards, lumps.query, again);
    CHECK(again.vertices == mesh.vertices);
    CHECK(again.triangles == mesh.triangles);
    CHECK(again.sides == mesh.sides);
    bool is_told = false;
    const ExtractReport none = extract_interfaces(*lumps.store, {}, lumps.query, again,
                                                  [&](const LabelInterface&) { is_told = true; });
    CHECK(again.vertices.empty());
    CHECK(again.sides.empty());
    CHECK(none.interfaces->interfaces == 0);
    CHECK_FALSE(is_told);
}

TEST_CASE("interfaces of labels that are not smooth are refused") {
    const Lumps lumps;
    MeshCollector mesh;
    LabelQuery query = lumps.query;
    query.smooth.reset();
    CHECK_THROWS_WITH(extract_interfaces(*lumps.store, lumps.labels, query, mesh),
                      Catch::Contains("smooth"));
    CHECK(mesh.triangles.empty());
}
