// A sink receives the same mesh as the file has, in any order.
#include <algorithm>
#include <catch2/catch.hpp>
#include <mutex>
#include <set>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail::test;

namespace {

/// A store of a noisy volume, and another one on the same lattice.
struct Subject {
    Subject()
        : volume({41, 37, 33}, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); }),
          other({41, 37, 33}, [](const Int3& p) { return 1e9 + static_cast<double>(p.x); }) {
        make_store(volume, folder / "s", with_chunk(8));
        make_store(other, folder / "o", with_chunk(8));
        store.emplace(folder / "s");
        values.emplace(folder / "o");
    }
    [[nodiscard]] SurfaceQuery query() const {
        SurfaceQuery q;
        q.iso = 0.3;
        q.stop = ErrorBound{0.05, false, ErrorIndicator::deviation};
        q.box = WorldBox{{1.5, 2.25, 3}, {38, 30.5, 29.75}};
        q.attributes.normals = true;
        q.attributes.values = &*values;
        q.attributes.error = Field::deviation_bar;
        return q;
    }
    [[nodiscard]] Mesh in_file() const {
        const auto path = folder / "m.ply";
        const auto sink = open_mesh_file(path, {.replace = true});
        extract(*store, query(), *sink);
        return read_mesh(path);
    }
    TemporaryFolder folder;
    FunctionVolume<double> volume;
    FunctionVolume<double> other;
    std::optional<Store> store;
    std::optional<Store> values;
};

/// Records the calls, and detects an order, counts or sizes that were not announced.
class Witness : public MeshSink {
  public:
    Witness(bool concurrent, int passes) : concurrent_(concurrent), passes_(passes) {}
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        CHECK(step_++ == 0);
        CHECK(layout.row_bytes == 24);
        CHECK(inputs.size() == 2);
    }
    void begin(const MeshLayout& layout) override {
        CHECK(step_++ == 1);
        layout_ = layout;
        positions.resize(layout.vertices);
        triangles.resize(layout.elements);
    }
    void add_vertices(const VertexBatch& batch) override {
        const std::lock_guard lock(mutex_);
        right = right && batch.positions.size() <= kMaxRows && batch.row_bytes == 24 &&
                batch.attributes.size() == 24 * batch.positions.size();
        right = right && (concurrent_ || (batch.first == vertices_seen && elements_seen == 0));
        vertices_seen += batch.positions.size();
        std::copy(batch.positions.begin(), batch.positions.end(),
                  positions.begin() + static_cast<std::ptrdiff_t>(batch.first));
    }
    void add_elements(const ElementBatch& batch) override {
        const std::lock_guard lock(mutex_);
        right = right && batch.corners.size() <= kMaxRows &&
                batch.nearby_corners.size() == batch.corners.size();
        right = right && (concurrent_ ||
                          (batch.first == elements_seen && vertices_seen == layout_.vertices));
        elements_seen += batch.corners.size();
        for (std::size_t i = 0; i < batch.corners.size(); ++i) {
            triangles[batch.first + i] = batch.corners[i];
            for (std::size_t c = 0; c < 3 && !concurrent_; ++c) {
                right = right && batch.nearby.positions[batch.nearby_corners[i][c]] ==
                                     positions[batch.corners[i][c]];
            }
        }
    }
    bool again() override {
        right = right && vertices_seen == layout_.vertices && elements_seen == layout_.elements;
        vertices_seen = 0;
        elements_seen = 0;
        return --passes_ > 0;
    }
    void end() override { CHECK(step_++ == 2); }
    [[nodiscard]] bool concurrent() const override { return concurrent_; }
    [[nodiscard]] bool ended() const { return step_ == 3 && passes_ == 0; }

    bool right = true;
    std::uint64_t vertices_seen = 0;
    std::uint64_t elements_seen = 0;
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<std::uint64_t, 3>> triangles;

  private:
    bool concurrent_;
    int passes_;
    int step_ = 0;
    MeshLayout layout_;
    std::mutex mutex_;
};

}  // namespace

TEST_CASE("a collector gets the same mesh as the file, including numbers and attributes") {
    const Subject subject;
    const Mesh file = subject.in_file();
    REQUIRE(file.triangles.size() > 1000);
    for (const int threads : {1, 3}) {
        MeshCollector mesh;
        const ExtractReport report =
            extract(*subject.store, subject.query(), mesh, {std::uint64_t{1} << 30U, threads, {}});
        CHECK(report.vertices == mesh.vertices.size());
        CHECK(mesh.vertices == file.vertices);
        CHECK(mesh.triangles == file.triangles);
        CHECK(mesh.lines.empty());
        bool same = mesh.normals.size() == file.vertices.size() &&
                    mesh.values.size() == file.vertices.size() &&
                    mesh.errors.size() == file.vertices.size();
        for (std::size_t i = 0; same && i < file.vertices.size(); ++i) {
            const std::vector<double>& a = file.attributes[i];
            same = a[0] == static_cast<double>(mesh.normals[i][0]) &&
                   a[2] == static_cast<double>(mesh.normals[i][2]) && a[3] == mesh.values[i] &&
                   a[4] == static_cast<double>(mesh.errors[i]);
        }
        CHECK(same);
        CHECK(std::any_of(mesh.values.begin(), mesh.values.end(), [](double v) {
            return v != static_cast<double>(static_cast<float>(v));  // has float64 precision
        }));
    }
}

TEST_CASE("batches arrive in the promised order and pass after pass, concurrently or one by one") {
    const Subject subject;
    const Mesh file = subject.in_file();
    for (const bool concurrent : {false, true}) {
        for (const int passes : {1, 3}) {
            Witness sink(concurrent, passes);
            extract(*subject.store, subject.query(), sink, {std::uint64_t{1} << 30U, 2, {}});
            CHECK(sink.right);
            CHECK(sink.ended());
            CHECK(sink.positions == file.vertices);
            CHECK(std::equal(file.triangles.begin(), file.triangles.end(), sink.triangles.begin(),
                             sink.triangles.end(), [](const auto& a, const auto& b) {
                                 return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
                             }));
        }
    }
}

TEST_CASE("callbacks get every vertex before the first triangle, and the bounding box of all") {
    const Subject subject;
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::array<float, 3> lo{1e9F, 1e9F, 1e9F};
    CallbackSink sink(
        [&](const VertexBatch& batch) {
            CHECK(triangles == 0);
            CHECK(batch.first == vertices);
            vertices += batch.positions.size();
            for (const auto& p : batch.positions) {
                for (std::size_t a = 0; a < 3; ++a) {
                    lo[a] = std::min(lo[a], p[a]);
                }
            }
        },
        [&](const ElementBatch& batch) { triangles += batch.corners.size(); });
    const ExtractReport report = extract(*subject.store, subject.query(), sink);
    CHECK(vertices == report.vertices);
    CHECK(triangles == report.triangles);
    CHECK(sink.layout().lo == lo);
}

TEST_CASE("contour lines are lines in memory, with their value") {
    const Subject subject;
    ContourQuery query;
    query.plane = {{0, 0, 1}, 12.5};
    query.values = {0.1, 0.6};
    MeshCollector mesh;
    const ExtractReport report = extract(*subject.store, query, mesh);
    CHECK(mesh.lines.size() == report.triangles);
    CHECK(mesh.triangles.empty());
    REQUIRE(!mesh.lines.empty());
    for (const double value : mesh.values) {
        CHECK((value == 0.1 || value == 0.6));
    }
    for (const auto& line : mesh.lines) {
        REQUIRE(mesh.values[line[0]] == mesh.values[line[1]]);
    }
}

TEST_CASE(
    "an exception of a sink ends the extraction and reaches the caller, and no file is left") {
    const Subject subject;
    struct Own {};
    CallbackSink thrower({}, [](const ElementBatch&) { throw Own{}; });
    CHECK_THROWS_AS(extract(*subject.store, subject.query(), thrower), Own);
    struct Stop : Progress {
        void begin(std::string_view phase, std::uint64_t, std::string_view) override {
            writing = writing || phase == "write mesh";
        }
        [[nodiscard]] bool cancelled() const override { return writing; }
        bool writing = false;
    } stop;
    const std::size_t before = subject.folder.names().size();
    {
        const auto sink = open_mesh_file(subject.folder / "n.vtp");
        ExtractOptions options;
        options.scratch = subject.folder.path();
        CHECK_THROWS_AS(extract(*subject.store, subject.query(), *sink, options, stop), Error);
    }
    CHECK(subject.folder.names().size() == before);
}

TEST_CASE("a mesh too large for a format's indices is refused before a file is made") {
    const TemporaryFolder folder;
    const auto is_refused = [&](const char* name, std::uint64_t vertices, std::uint64_t triangles) {
        MeshLayout layout;
        layout.vertices = vertices;
        layout.elements = triangles;
        bool refused = false;
        try {
            open_mesh_file(folder / name)->begin(layout);
        } catch (const Error& e) {
            refused = e.kind() == ErrorKind::limit && !e.remedies().empty();
        }
        CHECK(folder.names().empty());
        return refused;
    };
    constexpr std::uint64_t kSigned = std::uint64_t{1} << 31U;
    constexpr std::uint64_t kUnsigned = std::uint64_t{1} << 32U;
    CHECK(!is_refused("m.3mf", kSigned - 1, kSigned - 1));
    CHECK(is_refused("m.3mf", kSigned, 1));
    CHECK(is_refused("m.3mf", 3, kSigned));
    CHECK(!is_refused("m.stl", 3, kUnsigned - 1));
    CHECK(is_refused("m.stl", 3, kUnsigned));
    CHECK(!is_refused("m.ply", kUnsigned - 1, 1));
    CHECK(is_refused("m.ply", kUnsigned, 1));
}

TEST_CASE("an existing file is replaced only on request, and never the store") {
    const Subject subject;
    const auto kind_of = [&](const char* name, bool replace) {
        try {
            const auto sink = open_mesh_file(subject.folder / name, {replace});
            extract(*subject.store, subject.query(), *sink);
        } catch (const Error& e) {
            return static_cast<int>(e.kind());
        }
        return 0;
    };
    constexpr int kRefused = static_cast<int>(ErrorKind::invalid_argument);
    CHECK(kind_of("m.ply", false) == 0);
    CHECK(kind_of("m.ply", false) == kRefused);
    CHECK(kind_of("m.ply", true) == 0);
    CHECK(kind_of("m.txt", true) == kRefused);
    std::filesystem::create_hard_link(subject.folder / "s", subject.folder / "t.ply");
    CHECK(kind_of("t.ply", true) == kRefused);
}
