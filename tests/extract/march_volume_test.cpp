// Surfaces directly from volumes: bit for bit the triangles and vertices of a store's hexahedra at
// full resolution, and the same bytes for any threads, memory and way of reading.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/march.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>

#include "query/mesh/mend_triangles.h"
#include "query/mesh/vertex_stars.h"
#include "query/slabs/mend_slabs.h"
#include "tests/support/test_support.h"
#include "tests/support/whole_mesh.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Marched {
    MeshCollector mesh;
    ExtractReport report;
};

ExtractOptions with_threads(int threads) {
    ExtractOptions options;
    options.threads = threads;
    return options;
}

void march(Marched& to, VolumeSource& volume, double iso, const ExtractOptions& options = {}) {
    to.report = march_hexahedra(volume, {iso, true}, to.mesh, options);
}

void from_store(Marched& to, VolumeSource& volume, double iso) {
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(16);
    preprocess(volume, folder / "s", options, silent_progress());
    SurfaceQuery query;
    query.iso = iso;
    query.grid.cells = Cells::hexahedra;
    query.attributes.normals = true;
    to.report = extract(Store(folder / "s"), query, to.mesh);
}

/// A corner with its normal, a triangle starting at its smallest corner, and all triangles at one
/// vertex.
using Corner = std::array<float, 6>;
using Triangle = std::array<Corner, 3>;
using Star = std::vector<Triangle>;

/// The triangles around each vertex, without vertex numbers. Sheets that touch in a point have
/// separate vertices there, and so separate stars.
std::vector<Star> stars_of(const MeshCollector& mesh) {
    std::vector<Star> stars(mesh.vertices.size());
    for (const auto& t : mesh.triangles) {
        Triangle triangle{};
        for (std::size_t k = 0; k < 3; ++k) {
            std::copy_n(mesh.vertices[t[k]].begin(), 3, triangle[k].begin());
            std::copy_n(mesh.normals[t[k]].begin(), 3, triangle[k].begin() + 3);
        }
        std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                    triangle.end());
        for (const std::uint32_t v : t) {
            stars[v].push_back(triangle);
        }
    }
    for (Star& star : stars) {
        std::sort(star.begin(), star.end());
    }
    std::sort(stars.begin(), stars.end());
    return stars;
}

bool same_arrays(const MeshCollector& a, const MeshCollector& b) {
    return a.vertices == b.vertices && a.triangles == b.triangles && a.normals == b.normals;
}

/// Returns its values as mapped memory, like an array.
template <class T>
class Mapped : public FunctionVolume<T> {
  public:
    using FunctionVolume<T>::FunctionVolume;
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return std::as_bytes(std::span(numbers_));
    }
    /// Fills the mapped values from the source itself; to be called after construction.
    void map() {
        numbers_.resize(static_cast<std::size_t>(this->nodes().product()));
        this->read(0, this->nodes().z, 0, this->nodes().y,
                   reinterpret_cast<std::byte*>(numbers_.data()));
    }

  private:
    std::vector<T> numbers_;
};

template <class T>
using Function = std::function<T(const Int3&)>;

/// Checks everything that must be equal for one volume.
template <class T>
void check_volume(const Int3& nodes, double iso, const Function<T>& f) {
    Mapped<T> volume(nodes, f);
    volume.spacing_ = {0.5, 1.25, 2};
    Marched stored;
    from_store(stored, volume, iso);
    volume.map();
    Marched one;
    march(one, volume, iso, with_threads(1));
    CAPTURE(nodes.x, nodes.y, nodes.z, iso, name_of(value_type_of<T>));
    CHECK(one.mesh.triangles.size() == stored.mesh.triangles.size());
    CHECK(one.mesh.vertices.size() == stored.mesh.vertices.size());
    // Triangles without area are mended in the order of the mesh, which differs.
    const bool mended = stored.report.mending.mended > 0;
    CHECK((one.report.mending.mended > 0) == mended);
    CHECK(one.report.mending.zero_area == stored.report.mending.zero_area);
    if (!mended) {
        CHECK((stars_of(one.mesh) == stars_of(stored.mesh)));
    }
    CHECK(one.report.vertices == one.mesh.vertices.size());
    CHECK(one.report.triangles == one.mesh.triangles.size());
    CHECK(one.report.value_range == stored.report.value_range);
    CHECK(one.report.coordinate_rounding == stored.report.coordinate_rounding);
    CHECK(one.report.traversal.leaves == stored.report.traversal.leaves);
    REQUIRE(one.report.measures);
    REQUIRE(stored.report.measures);
    CHECK(one.report.measures->volume.has_value() == stored.report.measures->volume.has_value());
    if (!mended) {
        CHECK(one.report.measures->area == stored.report.measures->area);
        CHECK(one.report.measures->volume == stored.report.measures->volume);
    }
    for (const int threads : {2, 7}) {
        Marched other;
        march(other, volume, iso, with_threads(threads));
        CHECK(same_arrays(one.mesh, other.mesh));
    }
    // Read a few planes at a time, in slabs of one layer.
    FunctionVolume<T> read(nodes, f);
    read.spacing_ = volume.spacing_;
    read.granularity_ = {4, 2};
    ExtractOptions least = with_threads(2);
    least.memory = march_memory(read).value();
    Marched other;
    march(other, read, iso, least);
    CHECK(same_arrays(one.mesh, other.mesh));
    CHECK(read.planes_read_ == nodes.z);
}

template <class T>
T small_integer(const Int3& p) {
    return static_cast<T>(4 * noise(p));
}
template <class T>
T wave(const Int3& p) {
    return static_cast<T>(20 * (smooth(p) + 2.5) + 5 * noise(p));
}

const std::vector<Int3> shapes{{2, 2, 2},   {2, 9, 5},    {40, 2, 3}, {3, 2, 40},
                               {5, 4, 3},   {64, 5, 4},   {65, 4, 6}, {66, 3, 19},
                               {130, 4, 9}, {17, 19, 21}, {9, 23, 40}};

template <class T>
void check_type() {
    for (const Int3& nodes : shapes) {
        check_volume<T>(nodes, 50.5, wave<T>);
        check_volume<T>(nodes, 50, wave<T>);          // a few nodes on the surface
        check_volume<T>(nodes, 2, small_integer<T>);  // nearly all nodes on the surface
        check_volume<T>(nodes, 1.5, small_integer<T>);
    }
}

}  // namespace

TEST_CASE("Integers give the same surfaces as their stores") {
    check_type<std::uint8_t>();
    check_type<std::int8_t>();
    check_type<std::uint16_t>();
    check_type<std::int16_t>();
}

TEST_CASE("Wide integers and floats give the same surfaces as their stores") {
    check_type<std::uint32_t>();
    check_type<std::int32_t>();
    check_type<float>();
    check_type<double>();
}

TEST_CASE("The extremes of integer types are marched as ordinary values") {
    const auto ends = []<class T>(T /*type*/) {
        const Function<T> f = [](const Int3& p) {
            return noise(p) < 0.5 ? std::numeric_limits<T>::lowest()
                                  : std::numeric_limits<T>::max();
        };
        const auto low = static_cast<double>(std::numeric_limits<T>::lowest());
        const auto high = static_cast<double>(std::numeric_limits<T>::max());
        for (const double iso : {low, low + 0.5, low / 2 + high / 2, high - 0.5, high, high + 0.5,
                                 low - 1, 1e300, -1e300}) {
            check_volume<T>({9, 5, 6}, iso, f);
        }
    };
    ends(std::uint8_t{});
    ends(std::int16_t{});
    ends(std::uint32_t{});
    ends(std::int32_t{});
}

TEST_CASE("Values near the limits of floating-point types are marched without overflow") {
    const auto ends = []<class T>(T /*type*/) {
        const Function<T> f = [](const Int3& p) {
            return static_cast<T>((noise(p) - 0.5) * 2) * std::numeric_limits<T>::max();
        };
        for (const double iso : {0.0, 1e30, static_cast<double>(std::numeric_limits<T>::max()) / 3,
                                 static_cast<double>(std::numeric_limits<T>::max())}) {
            check_volume<T>({9, 5, 6}, iso, f);
        }
    };
    ends(float{});
    ends(double{});
}

TEST_CASE("Cells with a missing corner have no surface") {
    const auto holes = []<class T>(T /*type*/) {
        for (const T missing : {std::numeric_limits<T>::quiet_NaN(), static_cast<T>(kInfinity),
                                static_cast<T>(-kInfinity)}) {
            for (const double share : {0.02, 0.3, 1.0}) {
                const Function<T> sparse = [=](const Int3& p) {
                    return noise(p, 3) < share ? missing : small_integer<T>(p);
                };
                const Function<T> rough = [=](const Int3& p) {
                    return noise(p, 5) < share ? missing : wave<T>(p);
                };
                for (const Int3& nodes : {Int3{2, 2, 2}, Int3{70, 5, 19}, Int3{17, 19, 21}}) {
                    check_volume<T>(nodes, 2, sparse);
                    check_volume<T>(nodes, 50, rough);
                }
            }
        }
    };
    holes(float{});
    holes(double{});
}

TEST_CASE("Constant volumes have no surface, even at the isovalue, and plateaus have one") {
    check_volume<float>({9, 8, 7}, 1, [](const Int3&) { return 1.0F; });
    check_volume<float>({9, 8, 7}, 0.5, [](const Int3&) { return 1.0F; });
    check_volume<float>({20, 18, 27}, 1, [](const Int3& p) {
        const double r = std::hypot(p.x - 9.0, p.y - 8.0, p.z - 13.0);
        return r < 5 ? 2.0F : r < 8 ? 1.0F : 0.0F;
    });
    check_volume<std::uint8_t>({20, 18, 27}, 1, [](const Int3& p) {
        return static_cast<std::uint8_t>((p.x / 3 + p.y / 4 + p.z / 5) % 3);
    });
}

TEST_CASE("Sheets between slabs are closed and manifold with nodes at the isovalue") {
    FunctionVolume<std::uint8_t> volume({30, 28, 41}, [](const Int3& p) {
        return static_cast<std::uint8_t>(p.x % 29 == 0 || p.y % 27 == 0 || p.z % 40 == 0
                                             ? 0.0
                                             : 3 * noise({p.x / 2, p.y / 2, p.z / 3}));
    });
    for (const double iso : {1.0, 2.0, 1.5}) {
        Marched marched;
        march(marched, volume, iso, with_threads(7));
        require_whole({marched.mesh.vertices, {}, marched.mesh.triangles}, {-1, -1, -1},
                      {50, 50, 50});
        CHECK(marched.report.measures->volume.has_value());
    }
}

TEST_CASE("Arrays of any strides give the same mesh") {
    const Int3 nodes{13, 12, 21};
    std::vector<float> dense;
    std::vector<float> turned(static_cast<std::size_t>(nodes.product()));
    for (std::int64_t i = 0; i < nodes.product(); ++i) {
        const Int3 p = nodes.unlinear(i);
        dense.push_back(static_cast<float>(smooth(p)));
        turned[static_cast<std::size_t>((p.x * nodes.y + nodes.y - 1 - p.y) * nodes.z + p.z)] =
            dense.back();
    }
    MemoryVolume volume(dense.data(), nodes);
    MemoryLayout layout;
    layout.strides = Int3{4 * nodes.y * nodes.z, -4 * nodes.z, 4};
    MemoryVolume other(turned.data() + (nodes.y - 1) * nodes.z, nodes, layout);
    Marched a;
    Marched b;
    march(a, volume, 0.3);
    march(b, other, 0.3);
    CHECK(a.mesh.triangles.size() > 100);
    CHECK(same_arrays(a.mesh, b.mesh));
}

TEST_CASE("Triangles whose area vanishes in float32 are mended") {
    // So far from the origin that float32 has only 16 steps between neighbouring nodes.
    std::vector<float> values;
    const Int3 nodes{30, 31, 32};
    for (std::int64_t i = 0; i < nodes.product(); ++i) {
        values.push_back(static_cast<float>(smooth(nodes.unlinear(i))));
    }
    MemoryLayout layout;
    layout.origin = {1e6, 1e6, 1e6};
    MemoryVolume volume(values.data(), nodes, layout);
    Marched one;
    Marched two;
    march(one, volume, 0.3, with_threads(1));
    march(two, volume, 0.3, with_threads(2));
    CHECK(one.report.mending.mended > 0);
    CHECK(one.report.mending.zero_area == 0);
    CHECK(one.report.triangles == one.mesh.triangles.size());
    CHECK(one.mesh.normals.size() == one.mesh.vertices.size());
    CHECK(same_arrays(one.mesh, two.mesh));
    const MeshFaults faults = check_mesh({one.mesh.vertices, {}, one.mesh.triangles}, layout.origin,
                                         {1e6 + 29, 1e6 + 30, 1e6 + 31});
    CHECK(faults.flat_triangles == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
}

namespace {

/// Vertices in the order of their first use by triangles; removed triangles are left out.
void number_as_named(MeshCollector& mesh) {
    std::vector<std::uint32_t> number(mesh.vertices.size(), NumberedSlab::kNoNumber);
    MeshCollector named;
    for (auto t : mesh.triangles) {
        if (t[0] == kNoTriangle) {
            continue;
        }
        for (std::uint32_t& v : t) {
            if (number[v] == NumberedSlab::kNoNumber) {
                number[v] = static_cast<std::uint32_t>(named.vertices.size());
                named.vertices.push_back(mesh.vertices[v]);
            }
            v = number[v];
        }
        named.triangles.push_back(t);
    }
    mesh.vertices = named.vertices;
    mesh.triangles = named.triangles;
}

/// A slab's own copy of the data that NumberedSlab refers to.
struct SlabOfMesh {
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<std::uint32_t> number;
    std::vector<std::uint32_t> flat;
    std::uint64_t first_vertex = 0;
    std::uint64_t first_triangle = 0;
};

/// Triangles begin ... end - 1 with their vertices, in descending order. `named`: vertices of the
/// triangles before.
SlabOfMesh slab_of(const MeshCollector& mesh, std::size_t begin, std::size_t end,
                   std::uint64_t& named) {
    SlabOfMesh slab;
    slab.first_vertex = named;
    slab.first_triangle = begin;
    for (std::size_t i = begin; i < end; ++i) {
        const auto& t = mesh.triangles[i];
        slab.number.insert(slab.number.end(), t.begin(), t.end());
        named = std::max<std::uint64_t>(named, *std::max_element(t.begin(), t.end()) + 1ULL);
        if (has_no_area(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]])) {
            slab.flat.push_back(static_cast<std::uint32_t>(i - begin));
        }
    }
    std::sort(slab.number.rbegin(), slab.number.rend());
    slab.number.erase(std::unique(slab.number.begin(), slab.number.end()), slab.number.end());
    for (const std::uint32_t v : slab.number) {
        slab.positions.push_back(mesh.vertices[v]);
    }
    for (std::size_t i = begin; i < end; ++i) {
        auto& t = slab.triangles.emplace_back(mesh.triangles[i]);
        for (std::uint32_t& v : t) {
            v = static_cast<std::uint32_t>(std::find(slab.number.begin(), slab.number.end(), v) -
                                           slab.number.begin());
        }
    }
    return slab;
}

/// `now` gets the mesh after the changes.
void change(const MeshCollector& mesh, const MeshChanges& changes, MeshCollector& now) {
    now.vertices.resize(mesh.vertices.size() - changes.gone_vertices());
    now.triangles.resize(mesh.triangles.size() - changes.gone_triangles());
    MeshCollector before;
    before.vertices = mesh.vertices;
    before.triangles = mesh.triangles;
    for (const MeshChanges::Moved& m : changes.moved()) {
        before.vertices[m.vertex] = m.to;
    }
    for (const MeshChanges::Changed& c : changes.changed()) {
        before.triangles[c.triangle] = c.corners;
    }
    for (std::uint32_t v = 0; v < before.vertices.size(); ++v) {
        const std::uint32_t number = changes.vertex_now(v);
        CHECK(number == changes.numbers(v - v % 100, v + 100)(v));
        if (number != MeshChanges::kGone) {
            now.vertices.at(number) = before.vertices[v];
        }
    }
    for (std::size_t i = 0; i < before.triangles.size(); ++i) {
        auto t = before.triangles[i];
        if (t[0] != kNoTriangle) {
            std::transform(t.begin(), t.end(), t.begin(),
                           [&](std::uint32_t v) { return changes.vertex_now(v); });
            now.triangles.at(changes.triangle_now(i)) = t;
        }
    }
}

}  // namespace

TEST_CASE("Mending slabs gives the same mesh as mending the whole mesh") {
    FunctionVolume<float> volume(
        Int3{14, 15, 16}, [](const Int3& p) { return static_cast<float>(smooth(p) + noise(p)); });
    Marched marched;
    march(marched, volume, 0.3);
    std::uint64_t collapsed = 0;
    std::uint64_t moved_vertices = 0;
    // With this rounding, few or many triangles lose their area.
    for (const float steps : {128.0F, 32.0F, 8.0F, 2.0F}) {
        MeshCollector& mesh = marched.mesh;
        for (auto& p : mesh.vertices) {
            for (float& x : p) {
                x = std::round(x * steps) / steps;
            }
        }
        const std::array<float, 3> lo{0, 0, 0};
        const std::array<float, 3> hi{13, 14, 15};
        const Double3 min_step{kMinNudge, kMinNudge, kMinNudge};
        const TemporaryFolder folder;
        MeshCollector whole;
        whole.vertices = mesh.vertices;
        whole.triangles = mesh.triangles;
        std::vector<std::uint32_t> moved;
        const MendedTriangles mended =
            mend_triangles(whole.vertices, whole.triangles, lo, hi, min_step, moved, folder.path(),
                           silent_progress());
        REQUIRE(mended.found > 0);
        number_as_named(whole);
        for (const std::size_t size : {mesh.triangles.size(), std::size_t{500}, std::size_t{37}}) {
            std::vector<SlabOfMesh> parts;
            std::uint64_t named = 0;
            for (std::size_t i = 0; i < mesh.triangles.size(); i += size) {
                parts.push_back(slab_of(mesh, i, std::min(i + size, mesh.triangles.size()), named));
            }
            std::vector<NumberedSlab> slabs;
            for (const SlabOfMesh& p : parts) {
                slabs.push_back(
                    {p.positions, p.triangles, p.number, p.flat, p.first_vertex, p.first_triangle});
            }
            const MeshChanges changes(slabs, lo, hi, min_step, folder.path(), silent_progress());
            CAPTURE(steps, size, mended.found);
            CHECK(changes.mended().found == mended.found);
            CHECK(changes.mended().left == mended.left);
            CHECK(changes.moved().size() == moved.size());
            MeshCollector now;
            change(mesh, changes, now);
            CHECK(same_arrays(now, whole));
            collapsed += changes.gone_vertices();
            moved_vertices += changes.moved().size();
        }
    }
    CHECK(collapsed > 0);
    CHECK(moved_vertices > 0);
}

TEST_CASE("The range of a volume covers its finite values only") {
    FunctionVolume<float> volume({33, 9, 20}, [](const Int3& p) {
        return p == Int3{32, 8, 19} ? -7.0F
               : p == Int3{0, 0, 0} ? 1e30F
               : noise(p) < 0.2     ? std::numeric_limits<float>::quiet_NaN()
               : noise(p) < 0.3     ? std::numeric_limits<float>::infinity()
                                    : static_cast<float>(noise(p));
    });
    CHECK(finite_range(volume) == std::pair{-7.0, static_cast<double>(1e30F)});
    FunctionVolume<double> missing({3, 4, 5}, [](const Int3&) { return -kInfinity; });
    CHECK(!finite_range(missing));
    FunctionVolume<std::uint8_t> full({3, 4, 5}, [](const Int3&) { return std::uint8_t{255}; });
    CHECK(finite_range(full) == std::pair{255.0, 255.0});
}

TEST_CASE("Volumes that cannot be marched are refused") {
    const auto kind_of = [](VolumeSource& volume, double iso, const ExtractOptions& options = {}) {
        try {
            Marched to;
            march(to, volume, iso, options);
        } catch (const Error& error) {
            return static_cast<int>(error.kind());
        }
        return 0;
    };
    const auto invalid = static_cast<int>(ErrorKind::invalid_argument);
    const Function<float> f = [](const Int3& p) { return static_cast<float>(smooth(p)); };
    FunctionVolume<float> volume({9, 9, 9}, f);
    CHECK(kind_of(volume, 0.1) == 0);
    CHECK(kind_of(volume, kInfinity) == invalid);
    CHECK(kind_of(volume, std::nan("")) == invalid);
    for (const Int3& nodes : {Int3{1, 9, 9}, Int3{9, 1, 9}, Int3{9, 9, 1}, Int3{1, 1, 9}}) {
        FunctionVolume<float> flat(nodes, f);
        CHECK(kind_of(flat, 0.1) == invalid);
        CHECK(!march_memory(flat));
    }
    volume.spacing_ = {1, 0, 1};
    CHECK(kind_of(volume, 0.1) == invalid);
    volume.spacing_ = {1, 1e40, 1};
    CHECK(kind_of(volume, 0.1) == static_cast<int>(ErrorKind::limit));
    volume.spacing_ = {1, 1, 1};
    ExtractOptions little;
    little.memory = march_memory(volume).value() - 1;
    CHECK(kind_of(volume, 0.1, little) == static_cast<int>(ErrorKind::limit));
    little.memory += 1;
    CHECK(kind_of(volume, 0.1, little) == 0);

    class Cancelled : public Progress {
      public:
        [[nodiscard]] bool cancelled() const override { return true; }
    } stop;
    MeshCollector mesh;
    CHECK_THROWS_AS(march_hexahedra(volume, {0.1, false}, mesh, {}, stop), Error);
}
