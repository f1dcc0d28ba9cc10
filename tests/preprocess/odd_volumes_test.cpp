// Volumes and queries at the limits of the number types.
//
// ISONEST_BIG=1 in the environment, and "[big]": more than 2^32 nodes (some minutes).
#include <catch2/catch.hpp>
#include <cstdlib>

#include <isonest/error.h>

#include "query/check/check.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Makes a store, checks it with --deep against its source, and extracts at some isovalues.
template <class T>
std::vector<Mesh> all_of(FunctionVolume<T>& volume, const std::vector<double>& isovalues,
                         double error_relative = 0) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    CheckOptions deep;
    deep.depth = CheckDepth::deep;
    deep.sampled_cubes = 100;
    deep.source = &volume;
    const CheckReport report = check(store, deep, silent_progress());
    for (const Finding& f : report.findings) {
        UNSCOPED_INFO(f.test << " " << f.field << " " << f.message);
    }
    CHECK(report.failures == 0);
    std::vector<Mesh> meshes;
    for (const double iso : isovalues) {
        Extraction options;
        options.iso = iso;
        options.error_relative = error_relative;
        extract(store, folder / "m.ply", options, silent_progress());
        meshes.push_back(read_mesh(folder / "m.ply"));
        for (const auto& v : meshes.back().vertices) {
            CHECK((std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2])));
        }
    }
    return meshes;
}

/// A checkerboard of the lowest and the largest number of a type, with their mean on one side.
template <class T>
void opposites() {
    constexpr T kLow = std::numeric_limits<T>::lowest();
    constexpr T kHigh = std::numeric_limits<T>::max();
    FunctionVolume<T> volume({11, 10, 9}, [&](const Int3& p) {
        return p.x > 6                      ? static_cast<T>(kHigh / 2 + kLow / 2)
               : (p.x + p.y + p.z) % 2 == 0 ? kLow
                                            : kHigh;
    });
    const double middle = static_cast<double>(kLow) / 2 + static_cast<double>(kHigh) / 2;
    CAPTURE(name_of(value_type_of<T>));
    for (const double error : {0.0, 0.3}) {
        const std::vector<Mesh> meshes = all_of(
            volume, {middle + 0.25, static_cast<double>(kLow), static_cast<double>(kHigh)}, error);
        CHECK(!meshes[0].triangles.empty());
        const MeshFaults faults = check_mesh(meshes[0], {0, 0, 0}, {10, 9, 8});
        CHECK(faults.open_edges_inside == 0);
        CHECK(faults.overused_edges == 0);
        CHECK(meshes[1].triangles.empty());  // nothing is below the smallest value
    }
}

/// Zero except at a few nodes, computed while it is read.
class Sparse : public VolumeSource {
  public:
    explicit Sparse(const Int3& n) : n_(n) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription volume;
        volume.nodes = n_;
        volume.type = ValueType::u8;
        volume.name = "sparse";
        return volume;
    }
    [[nodiscard]] std::string identity() const override { return "sparse"; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        std::memset(dst, 0, static_cast<std::size_t>(nz * ny * n_.x));
        for (std::int64_t z = z0; z < z0 + nz; ++z) {
            for (const std::int64_t i : {std::int64_t{0}, std::int64_t{2}}) {
                // The same corner of the plane, and one far beyond 2^32 nodes.
                const std::int64_t y = i == 0 ? 3 : n_.y - 4;
                const std::int64_t x = i == 0 ? 5 : n_.x - 6;
                if (y >= y0 && y < y0 + ny && (z == 1 || z == n_.z - 2)) {
                    dst[((z - z0) * ny + (y - y0)) * n_.x + x] = std::byte{200};
                }
            }
        }
    }

  private:
    Int3 n_;
};

}  // namespace

TEST_CASE("the extremes of every type give a valid store and a surface without cracks") {
#define ISONEST_OPPOSITES(tag, T) opposites<T>();
    ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_OPPOSITES)
#undef ISONEST_OPPOSITES
}

TEST_CASE("denormals have a surface like other numbers") {
    FunctionVolume<float> small({12, 11, 13}, [](const Int3& p) {
        return static_cast<float>((p.x + 2 * p.y - p.z + (p.x * p.y) % 3) * 1e-42);
    });
    CHECK(!all_of(small, {5.5e-42})[0].triangles.empty());
    CHECK(!all_of(small, {5.5e-42}, 0.1)[0].triangles.empty());
    FunctionVolume<double> smaller({12, 11, 13}, [](const Int3& p) {
        return static_cast<double>(p.x + 2 * p.y - p.z) * 5e-322;
    });
    CHECK(!all_of(smaller, {5.1e-321})[0].triangles.empty());
}

TEST_CASE(
    "an isovalue outside the range, and any isovalue of an empty volume, give an empty mesh") {
    FunctionVolume<float> ramp({9, 9, 9}, [](const Int3& p) { return static_cast<float>(p.x); });
    for (const Mesh& mesh : all_of(ramp, {-0.5, 8.5, 1e300, -1e300})) {
        CHECK(mesh.triangles.empty());
    }
    constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    for (const float v : {kNaN, kInfinity, -kInfinity, 3.0F}) {
        FunctionVolume<float> constant({17, 5, 9}, [&](const Int3& /*p*/) { return v; });
        for (const Mesh& mesh : all_of(constant, {0, 3, 2.5}, 0)) {
            CHECK(mesh.triangles.empty());
        }
    }
    FunctionVolume<float> both({9, 9, 9},
                               [&](const Int3& p) { return p.x < 4 ? kInfinity : -kInfinity; });
    CHECK(all_of(both, {0})[0].triangles.empty());
}

TEST_CASE("errors and isovalues that are not finite are refused") {
    const TemporaryFolder folder;
    FunctionVolume<float> ramp({9, 9, 9}, [](const Int3& p) { return static_cast<float>(p.x); });
    make_store(ramp, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const auto kind = [&](double iso, double error, double relative) {
        Extraction options;
        options.iso = iso;
        options.error = error;
        if (relative != 0) {
            options.error.reset();
            options.error_relative = relative;
        }
        try {
            extract(store, folder / "m.ply", options, silent_progress());
        } catch (const Error& error_of) {
            return error_of.kind();
        }
        return ErrorKind::cancelled;
    };
    for (const double bad : {kNaN, kInfinity, -kInfinity, -1.0}) {
        CHECK(kind(1, bad, 0) == ErrorKind::invalid_argument);
        CHECK(kind(1, 0, bad) == ErrorKind::invalid_argument);
        if (bad != -1.0) {
            CHECK(kind(bad, 0, 0) == ErrorKind::invalid_argument);
        }
    }
    CHECK(!std::filesystem::exists(folder / "m.ply"));
    CHECK(folder.names().size() == 1);
}

TEST_CASE("a line of a million nodes, prime sizes and pairs give valid stores") {
    for (const Int3& n :
         {Int3{1000000, 1, 1}, Int3{1, 1000000, 1}, Int3{1, 1, 1000000}, Int3{1, 1, 1},
          Int3{2, 2, 2}, Int3{1, 2, 2}, Int3{13, 29, 7}, Int3{101, 3, 2}, Int3{2, 1, 103}}) {
        CAPTURE(n.x, n.y, n.z);
        FunctionVolume<std::uint8_t> volume(n, [](const Int3& p) {
            return static_cast<std::uint8_t>(255 * noise({p.x / 50, p.y / 50, p.z / 50}));
        });
        const TemporaryFolder folder;
        PreprocessOptions options = with_chunk(n.product() > 10000 ? 64 : 8);
        const PreprocessReport r = make_store(volume, folder / "s", options);
        CHECK(r.nodes == n);
        const StoreReader store(folder / "s");
        CHECK(check(store, {}, silent_progress()).failures == 0);
    }
}

TEST_CASE("more than 2^32 nodes are counted and found", "[.big]") {
    REQUIRE(std::getenv("ISONEST_BIG") != nullptr);
    const Int3 n{65536 + 8, 16384 + 5, 4};
    Sparse source(n);
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(256);
    options.memory = std::uint64_t{4} << 30U;
    const PreprocessReport r = preprocess(source, folder / "s", options, silent_progress());
    CHECK(r.input_bytes > std::uint64_t{1} << 32U);
    const StoreReader store(folder / "s");
    Extraction query;
    query.iso = 100;
    extract(store, folder / "m.ply", query, silent_progress());
    const Mesh mesh = read_mesh(folder / "m.ply");
    std::size_t near = 0;
    std::size_t far = 0;
    for (const auto& v : mesh.vertices) {
        near += std::fabs(v[0] - 5) < 2 && std::fabs(v[1] - 3) < 2 ? 1 : 0;
        far += std::fabs(v[0] - static_cast<double>(n.x - 6)) < 2 &&
                       std::fabs(v[1] - static_cast<double>(n.y - 4)) < 2
                   ? 1
                   : 0;
    }
    CHECK(near > 10);
    CHECK(far > 10);
    CHECK(near + far == mesh.vertices.size());
    CheckOptions quick;
    quick.depth = CheckDepth::quick;
    CHECK(check(store, quick, silent_progress()).failures == 0);
}
