// Extractions whose traversals are shared by ranks: the same bytes and report as one process.
#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <limits>
#include <utility>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>

#include "query/extract/extract_shared.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kAmple = std::uint64_t{1} << 30U;

struct Extracted {
    std::string bytes;
    ExtractReport report;
    std::vector<RankWork> work;  ///< of each rank
};

template <class Query>
Extracted alone(const Store& store, const Query& query, const char* end = ".ply") {
    const TemporaryFolder folder;
    const auto path = folder.path() / (std::string("mesh") + end);
    const auto sink = open_mesh_file(path);
    Extracted e;
    e.report = extract(store, query, *sink, {kAmple, 1, {}});
    e.bytes = read_file(path);
    return e;
}

template <class Query>
Extracted on_ranks(int count, const Store& store, const Query& query, const char* end = ".ply",
                   std::uint64_t memory = kAmple) {
    const TemporaryFolder folder;
    const auto path = folder.path() / (std::string("mesh") + end);
    Extracted e;
    e.work.resize(static_cast<std::size_t>(count));
    isonest::test::ThreadRanks(count).run([&](Communicator& ranks) {
        const Store own(store.path());
        e.work[static_cast<std::size_t>(ranks.rank())] = extract_on_ranks(
            ranks, own, query.attributes.values,
            [&](const ExtractOptions& options) {
                const auto sink = open_mesh_file(path);
                e.report = extract(own, query, *sink, options);
            },
            {memory, 2, {}}, silent_progress());
    });
    e.bytes = read_file(path);
    return e;
}

/// REQUIRES: the bricks of `e` are those of `expected`, plus possibly some that a border between
/// ranks crosses.
void require_same_report(const ExtractReport& e, const ExtractReport& expected) {
    CHECK(e.vertices == expected.vertices);
    CHECK(e.triangles == expected.triangles);
    CHECK(e.tolerance == expected.tolerance);
    CHECK(e.value_rounding == expected.value_rounding);
    CHECK(e.error_bound == expected.error_bound);
    CHECK(e.coordinate_rounding == expected.coordinate_rounding);
    CHECK(e.traversal.visited == expected.traversal.visited);
    CHECK(e.traversal.leaves == expected.traversal.leaves);
    CHECK(e.traversal.chunks_total == expected.traversal.chunks_total);
    CHECK(e.mending.mended == expected.mending.mended);
    CHECK(e.apart.moved == expected.apart.moved);
    CHECK(e.measures.has_value() == expected.measures.has_value());
    if (e.measures && expected.measures) {
        CHECK(e.measures->area == expected.measures->area);
        CHECK(e.measures->volume == expected.measures->volume);
    }
}

template <class Query>
void require_same(const Store& store, const Query& query, const char* end = ".ply") {
    const Extracted expected = alone(store, query, end);
    REQUIRE(!expected.bytes.empty());
    for (const int count : {1, 2, 3, 4, 7, 16}) {
        CAPTURE(count, end, store.nodes().x, store.nodes().y, store.nodes().z);
        const Extracted e = on_ranks(count, store, query, end);
        CHECK(e.bytes == expected.bytes);
        require_same_report(e.report, expected.report);
    }
}

float waves(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.1 * noise(p));
}

template <class T>
struct Made {
    Made(const Int3& n, const std::function<T(const Int3&)>& f, PreprocessOptions options)
        : volume(n, f) {
        make_store(volume, folder / "s", std::move(options));
        store.emplace(folder / "s");
    }
    TemporaryFolder folder;
    FunctionVolume<T> volume;
    std::optional<Store> store;
};

PreprocessOptions chunk_8() {
    PreprocessOptions options = with_chunk(8);
    options.fields = {Field::deviation_bar, Field::grad_linf_plus, Field::hex_deviation};
    return options;
}

SurfaceQuery surface(double iso, double error = 0) {
    SurfaceQuery query;
    query.iso = iso;
    query.stop = ErrorBound{error, false, ErrorIndicator::deviation};
    query.effort = Effort::none;
    query.grid.cells = Cells::tetrahedra;
    return query;
}

}  // namespace

TEST_CASE("ranks write the bytes of one process, at full resolution and within errors") {
    const Made<float> made({67, 50, 41}, waves, chunk_8());
    for (const double error : {0.0, 0.05, 0.3, 1.5}) {
        CAPTURE(error);
        require_same(*made.store, surface(0.2, error));
    }
    for (const char* const end : {".vtp", ".stl", ".vtkhdf", ".glb", ".ngmesh", ".obj"}) {
        require_same(*made.store, surface(0.2, 0.1), end);
    }
}

TEST_CASE("meshes that need no stage are welded and written by all ranks") {
    // The isovalue of the second one is that of many nodes, so that vertices are moved apart.
    const Made<float> made({67, 50, 41}, waves, chunk_8());
    const Made<std::uint8_t> touching(
        {33, 40, 37},
        [](const Int3& p) {
            return static_cast<std::uint8_t>(std::lround(4 + 2 * smooth(p) + noise(p)));
        },
        with_chunk(16));
    const auto meshes = [](const Extracted& e) {
        std::uint64_t triangles = 0;
        for (const RankWork& work : e.work) {
            CHECK(work.meshes == e.work.front().meshes);
            triangles += work.written_triangles;
        }
        CHECK(triangles == (e.work.front().meshes > 0 ? e.report.triangles : 0));
        return e.work.front().meshes;
    };
    for (const char* const end : {".ply", ".stl", ".vtp", ".vtkhdf", ".glb", ".ngmesh"}) {
        CAPTURE(end);
        CHECK(meshes(on_ranks(3, *made.store, surface(0.2), end)) == 1);
    }
    const Extracted moved = on_ranks(3, *touching.store, surface(5));
    CHECK(meshes(moved) == 1);
    CHECK(moved.report.apart.moved > 0);
    CHECK(std::all_of(moved.work.begin(), moved.work.end(),
                      [](const RankWork& w) { return w.written_triangles > 0; }));
    // Text, components and a single rank.
    CHECK(meshes(on_ranks(3, *made.store, surface(0.2), ".obj")) == 0);
    SurfaceQuery components = surface(0.2);
    components.stages.components = ComponentChoice{};
    components.stages.components->largest = 2;
    CHECK(meshes(on_ranks(3, *made.store, components)) == 0);
    CHECK(meshes(on_ranks(1, *made.store, surface(0.2))) == 0);
}

TEST_CASE("a mesh that all ranks write has the angles of one process") {
    const Made<float> made({45, 60, 33}, waves, with_chunk(8));
    const auto quality = [&](const ExtractOptions& options) {
        const TemporaryFolder folder;
        const auto sink = open_mesh_file(folder / "m.stl");
        return extract(*made.store, surface(0.2, 0.1), *sink, options).quality.value();
    };
    const TriangleQuality expected = quality({kAmple, 1, {}, true});
    TriangleQuality shared;
    isonest::test::ThreadRanks(3).run([&](Communicator& ranks) {
        extract_on_ranks(
            ranks, *made.store, nullptr,
            [&](const ExtractOptions& options) { shared = quality(options); },
            {kAmple, 1, {}, true}, silent_progress());
    });
    CHECK(shared.least == expected.least);
    CHECK(shared.per_mille == expected.per_mille);
    CHECK(shared.median == expected.median);
    CHECK(shared.narrow_share == expected.narrow_share);
}

TEST_CASE("ranks write the bytes of one process, for all options") {
    const Made<float> made({45, 60, 33}, waves, chunk_8());
    const Store& store = *made.store;
    SurfaceQuery query = surface(0.2, 0.15);
    SECTION("hexahedra") {
        for (const double error : {0.0, 0.1, 0.4}) {
            query = surface(0.2, error);
            query.grid.cells = Cells::hexahedra;
            require_same(store, query);
        }
    }
    SECTION("a box, and attributes") {
        query.box = WorldBox{{3.3, 4.1, 2.7}, {31.2, 49.9, 22.5}};
        query.attributes = {true, &store, Field::deviation_bar};
        require_same(store, query, ".vtp");
        query.stop = ErrorBound{};
        require_same(store, query, ".vtp");
    }
    SECTION("a closed box") {
        query.box = WorldBox{{3, 4.1, 2.7}, {31, 49.9, 22.5}};
        query.stages.close = Outside::below;
        require_same(store, query);
        query.grid.cells = Cells::hexahedra;
        query.stop = ErrorBound{};
        require_same(store, query);
    }
    SECTION("without back faces") {
        query.grid.culling = BackfaceCulling{{1, 2, -1}, Field::grad_linf_plus};
        require_same(store, query);
        query.stop = ErrorBound{};
        require_same(store, query);
    }
    SECTION("components") {
        query.stages.components = ComponentChoice{};
        query.stages.components->largest = 2;
        require_same(store, query);
    }
    SECTION("exact vertices, and a focus") {
        query.grid.vertices = VertexPlace::exact;
        query.focus = Focus{{20, 20, 10}, {20, 20, 10}, 0.05};
        require_same(store, query);
    }
    SECTION("within a distance") {
        query.grid.cells.reset();
        query.stop = DistanceBound{0.5};
        query.effort = Effort::fast;
        require_same(store, query);
    }
    SECTION("a search for an error") {
        query.stop = TriangleBudgetByError{2000};
        require_same(store, query);
    }
    SECTION("an interval of the volume") {
        query.stages.close = Outside::below;
        query.volume_interval = true;
        const Extracted expected = alone(store, query);
        const Extracted e = on_ranks(3, store, query);
        CHECK(e.bytes == expected.bytes);
        REQUIRE(e.report.volume_interval);
        CHECK(e.report.volume_interval->least == expected.report.volume_interval->least);
        CHECK(e.report.volume_interval->most == expected.report.volume_interval->most);
    }
    SECTION("a slice and its contour lines") {
        SliceQuery slice;
        slice.plane = WorldPlane{{1, 2, 3}, 125};
        slice.stop = ErrorBound{0.05};
        require_same(store, slice, ".vtp");
        ContourQuery contours;
        contours.plane = slice.plane;
        contours.values = {-0.3, 0.2};
        const Extracted expected = [&] {
            const TemporaryFolder folder;
            const auto sink = open_mesh_file(folder / "m.vtp");
            Extracted x;
            x.report = extract(store, contours, *sink, {kAmple, 2, {}});
            x.bytes = read_file(folder / "m.vtp");
            return x;
        }();
        const TemporaryFolder folder;
        isonest::test::ThreadRanks(4).run([&](Communicator& ranks) {
            extract_on_ranks(
                ranks, store, nullptr,
                [&](const ExtractOptions& options) {
                    const auto sink = open_mesh_file(folder / "m.vtp");
                    extract(store, contours, *sink, options);
                },
                {kAmple, 2, {}}, silent_progress());
        });
        CHECK(read_file(folder / "m.vtp") == expected.bytes);
    }
}

TEST_CASE("ranks write the bytes of one process for volumes of odd shapes") {
    for (const Int3& n :
         {Int3{2, 2, 2}, Int3{3, 2, 70}, Int3{129, 3, 2}, Int3{1, 1, 40}, Int3{1, 50, 41},
          Int3{40, 33, 1}, Int3{9, 9, 9}, Int3{8, 8, 8}, Int3{17, 16, 15}}) {
        PreprocessOptions options = with_chunk(8);
        const Made<float> made(n, waves, options);
        const bool has_lines = n.x == 1 || n.y == 1 || n.z == 1;
        for (const double error : {0.0, 0.2}) {
            if (has_lines && (n.x == 1) + (n.y == 1) + (n.z == 1) > 1) {
                continue;
            }
            require_same(*made.store, surface(0.2, error), has_lines ? ".vtp" : ".ply");
        }
    }
}

TEST_CASE("ranks write the bytes of one process beside missing values and through nodes") {
    const Made<float> holes(
        {40, 37, 30},
        [](const Int3& p) {
            return noise(p, 3) < 0.02 ? std::numeric_limits<float>::quiet_NaN() : waves(p);
        },
        with_chunk(8));
    const Made<std::uint8_t> plateaus(
        {33, 40, 37},
        [](const Int3& p) {
            return static_cast<std::uint8_t>(std::lround(4 + 2 * smooth(p) + noise(p)));
        },
        with_chunk(16));
    for (const double error : {0.0, 0.5}) {
        require_same(*holes.store, surface(0.2, error / 5));
        require_same(*plateaus.store, surface(5, error));
    }
    // An empty surface, and a constant volume.
    require_same(*holes.store, surface(1000));
    const Made<float> flat(
        {20, 20, 20}, [](const Int3&) { return 1.0F; }, with_chunk(8));
    require_same(*flat.store, surface(1));
}

TEST_CASE("ranks share a store with a single brick, and hexahedra with single cells") {
    for (const Int3& n : {Int3{2, 2, 2}, Int3{20, 30, 25}}) {
        PreprocessOptions options = chunk_8();
        options.chunk = 64;
        const Made<float> made(n, waves, options);
        for (const double error : {0.0, 0.2}) {
            SurfaceQuery query = surface(0.2, error);
            require_same(*made.store, query);
            query.grid.cells = Cells::hexahedra;
            require_same(*made.store, query);
            const Extracted e = on_ranks(3, *made.store, query);
            const auto with_work = std::count_if(e.work.begin(), e.work.end(),
                                                 [](const RankWork& w) { return w.leaves > 0; });
            CHECK((n.x == 2 || error > 0 || with_work == 3));
        }
    }
}

TEST_CASE("ranks share the work, and little memory changes no byte") {
    const Made<float> made({129, 97, 65}, waves, with_chunk(8));
    for (const double error : {0.0, 0.1}) {
        const Extracted expected = alone(*made.store, surface(0.2, error));
        const Extracted e =
            on_ranks(5, *made.store, surface(0.2, error), ".ply", std::uint64_t{20} << 20U);
        CHECK(e.bytes == expected.bytes);
        CHECK(e.report.scratch_bytes > 0);
        std::uint64_t leaves = 0;
        std::uint64_t most = 0;
        for (const RankWork& work : e.work) {
            leaves += work.leaves;
            most = std::max(most, work.leaves);
        }
        CHECK(leaves == expected.report.traversal.leaves);
        CHECK((error > 0 || e.report.traversal.bricks == expected.report.traversal.bricks));
        CHECK(most * e.work.size() * 10 < leaves * 12);
        CHECK(e.report.traversal.bricks >= expected.report.traversal.bricks);
        CHECK(e.report.traversal.bricks <= expected.report.traversal.bricks + 5 * 8);
    }
}

TEST_CASE("ranks also share several isovalues at once, and labels") {
    const Made<std::uint8_t> made(
        {40, 45, 38},
        [](const Int3& p) { return static_cast<std::uint8_t>(std::lround(10 + 3 * smooth(p))); },
        with_chunk(8));
    const Store& store = *made.store;
    const std::vector<double> isovalues{7.5, 10, 12.25};
    const auto files = [&](const ExtractOptions& options) {
        const TemporaryFolder folder;
        std::vector<std::string> all;
        const auto path = [&](std::size_t i) {
            return folder.path() / (std::to_string(i) + ".ply");
        };
        extract_isovalues(
            store, isovalues, surface(0), [&](std::size_t i) { return open_mesh_file(path(i)); },
            [&](std::size_t i, const ExtractReport&) { all.push_back(read_file(path(i))); },
            options);
        return all;
    };
    const std::vector<std::string> expected = files({kAmple, 2, {}});
    for (const int count : {2, 5}) {
        std::vector<std::string> shared;
        isonest::test::ThreadRanks(count).run([&](Communicator& ranks) {
            extract_on_ranks(
                ranks, store, nullptr,
                [&](const ExtractOptions& options) { shared = files(options); }, {kAmple, 2, {}},
                silent_progress());
        });
        CHECK(shared == expected);
    }
    LabelQuery label;
    label.label = {11};
    require_same(store, label);
}

namespace {

/// Three ranks, of which `failing` is cancelled when `Stopping` says so: all are cancelled, and no
/// file is left.
template <class Stopping>
void require_all_cancelled(const Made<float>& made, int failing) {
    const TemporaryFolder folder;
    std::atomic<int> failed = 0;
    const auto run = [&] {
        isonest::test::ThreadRanks(3).run([&](Communicator& ranks) {
            try {
                Stopping progress(ranks.rank() == failing);
                extract_on_ranks(
                    ranks, *made.store, nullptr,
                    [&](const ExtractOptions& options) {
                        const auto sink = open_mesh_file(folder / "m.ply");
                        extract(*made.store, surface(0.2), *sink, options, progress);
                    },
                    {kAmple, 1, {}}, progress);
            } catch (const Error& error) {
                failed += error.kind() == ErrorKind::cancelled ? 1 : 0;
                throw;
            }
        });
    };
    CHECK_THROWS_AS(run(), Error);
    CHECK(failed == 3);
    CHECK(folder.names().empty());
}

}  // namespace

TEST_CASE("a rank that fails ends all ranks, and no file is left") {
    const Made<float> made({67, 50, 41}, waves, with_chunk(8));
    /// Stops one rank in the middle of its traversal.
    class Stops : public Progress {
      public:
        explicit Stops(bool ever) : ever_(ever) {}
        [[nodiscard]] bool cancelled() const override { return ever_ && ++asked_ > 20; }

      private:
        bool ever_;
        mutable std::atomic<int> asked_ = 0;
    };
    for (const int failing : {0, 2}) {
        require_all_cancelled<Stops>(made, failing);
    }
}

TEST_CASE("a rank that fails while all ranks write ends all, and no file is left") {
    const Made<float> made({67, 50, 41}, waves, with_chunk(8));
    /// Stops one rank once it is writing.
    class StopsWriting : public Progress {
      public:
        explicit StopsWriting(bool ever) : ever_(ever) {}
        void begin(std::string_view stage, std::uint64_t, std::string_view) override {
            writes_ = writes_ || stage == "write mesh";
        }
        [[nodiscard]] bool cancelled() const override { return ever_ && writes_; }

      private:
        bool ever_;
        std::atomic<bool> writes_ = false;
    };
    for (const int failing : {0, 1, 2}) {
        require_all_cancelled<StopsWriting>(made, failing);
    }
}

TEST_CASE("a rank that opens a different store reports it") {
    const Made<float> made({30, 30, 30}, waves, with_chunk(8));
    const Made<float> other({30, 30, 31}, waves, with_chunk(8));
    const TemporaryFolder folder;
    const auto run = [&] {
        isonest::test::ThreadRanks(2).run([&](Communicator& ranks) {
            const Store& own = ranks.rank() == 0 ? *made.store : *other.store;
            extract_on_ranks(
                ranks, own, nullptr,
                [&](const ExtractOptions& options) {
                    const auto sink = open_mesh_file(folder / "m.ply");
                    extract(own, surface(0.2), *sink, options);
                },
                {kAmple, 1, {}}, silent_progress());
        });
    };
    CHECK_THROWS_WITH(run(), Catch::Contains("a different store"));
    CHECK(folder.names().empty());
}
