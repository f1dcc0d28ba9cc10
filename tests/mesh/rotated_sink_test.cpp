// What a rotated mesh reports is true after the rotation: its bounding box, and the number of its
// triangles without area in float32. Compared with what the next sink receives.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <thread>

#include "query/extract/report.h"
#include "query/mesh/mesh_sinks.h"
#include "query/mesh/vertex_stars.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

/// Counts, and requests everything twice, as some formats do.
class Counting : public MeshSink {
  public:
    void begin(const MeshLayout& layout) override { layout_ = layout; }
    void add_vertices(const VertexBatch& batch) override {
        for (const auto& p : batch.positions) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                outside += p[axis] < layout_.lo[axis] || p[axis] > layout_.hi[axis] ? 1 : 0;
            }
        }
    }
    void add_elements(const ElementBatch& batch) override {
        triangles += batch.corners.size();
        const auto& at = batch.nearby.positions;
        flat += static_cast<std::uint64_t>(std::count_if(
            batch.nearby_corners.begin(), batch.nearby_corners.end(),
            [&](const auto& c) { return has_no_area(at[c[0]], at[c[1]], at[c[2]]); }));
    }
    [[nodiscard]] bool again() override { return ++passes < 2; }
    void end() override {}

    [[nodiscard]] const MeshLayout& layout() const { return layout_; }

    int passes = 0;
    std::uint64_t triangles = 0;
    std::uint64_t flat = 0;
    std::uint64_t outside = 0;

  private:
    MeshLayout layout_;
};

}  // namespace

TEST_CASE("triangles without area after rotation are counted, each once") {
    // A row of triangles that are small compared with the unit in the last place at their new
    // position.
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<std::uint64_t, 3>> corners;
    std::vector<std::array<std::uint32_t, 3>> nearby;
    constexpr std::uint32_t kVertices = 3000;
    constexpr float kUnit = 0x1p-5F;
    for (std::uint32_t v = 0; v < kVertices; ++v) {
        positions.push_back({kUnit * static_cast<float>(v), v % 2 == 0 ? 0 : kUnit, 1});
        if (v >= 2) {
            corners.push_back({v - 2, v - 1, v});
            nearby.push_back({v - 2, v - 1, v});
            CHECK(!has_no_area(positions[v - 2], positions[v - 1], positions[v]));
        }
    }
    const double c = std::cos(0.6);
    const double s = std::sin(0.6);
    Counting inner;
    ExtractQuery query;
    query.rotation = Rotation{{1e6, 0, 0}, Directions{Double3{c, s, 0}, {-s, c, 0}, {0, 0, 1}}};
    WorldOutput output(inner, query, {}, silent_progress());
    MeshSink& sink = output.sink();
    MeshLayout layout;
    layout.vertices = positions.size();
    layout.elements = corners.size();
    sink.begin(layout);
    do {
        sink.add_vertices({0, positions, {}, 0});
        sink.add_elements({0, corners, nearby, {0, positions, {}, 0}});
    } while (sink.again());
    sink.end();
    CHECK(inner.passes == 2);
    CHECK(inner.triangles == 2 * corners.size());
    CHECK(inner.outside == 0);
    const std::uint64_t found = output.report({}).mending.zero_area;
    CHECK(found > 0);
    CHECK(2 * found == inner.flat);
}

TEST_CASE("the bounding box of vertices added by several threads is that of all vertices") {
    constexpr std::size_t kThreads = 4;
    constexpr std::size_t kBatches = 200;
    const auto box_of = [](bool at_once) {
        Counting inner;
        RotatedSink sink(inner, {0, 0, 0}, Directions{Double3{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}});
        sink.begin({});
        const auto add = [&](std::size_t first) {
            for (std::size_t i = first; i < kThreads * kBatches; i += kThreads) {
                const auto x = static_cast<float>(i);
                const std::vector<std::array<float, 3>> positions{{x, -2 * x, 3 - x}};
                sink.add_vertices({i, positions, {}, 0});
            }
        };
        std::vector<std::thread> threads;
        for (std::size_t first = 0; first < kThreads; ++first) {
            if (at_once) {
                threads.emplace_back(add, first);
            } else {
                add(first);
            }
        }
        for (std::thread& thread : threads) {
            thread.join();
        }
        CHECK(sink.again());
        return std::pair(inner.layout().lo, inner.layout().hi);
    };
    CHECK(box_of(true) == box_of(false));
    constexpr float kLast = kThreads * kBatches - 1;
    CHECK(box_of(true).second == std::array<float, 3>{2 * kLast, kLast, 3});
}
