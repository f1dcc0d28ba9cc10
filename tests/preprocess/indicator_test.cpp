// The indicators in a store compared with an explicit recursive bisection.
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>

#include <isonest/export_field.h>

#include "query/check/check.h"
#include "query/values/node_sampler.h"
#include "store/lattice/simplex.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

std::vector<float> exported(const StoreReader& store, Field field,
                            const std::filesystem::path& path) {
    ExportOptions options;
    options.field = field;
    options.force = true;
    export_field(Store(store.path()), path, options);
    const std::string bytes = read_file(path);
    std::vector<float> out(bytes.size() / 4);
    std::memcpy(out.data(), bytes.data(), bytes.size());
    return out;
}

struct Comparison {
    std::size_t compared = 0;
    std::map<Field, std::size_t> wrong;
    std::size_t extra_nodes = 0;
    double ratio_sum = 0;  ///< deviation_bar divided by the exact one
    std::size_t ratios = 0;
};

/// `above`: how far a stored value may exceed the exact one, relatively.
template <class T>
Comparison compare(FunctionVolume<T>& volume, int chunk, bool exact, double above,
                   const std::vector<Field>& fields = with_chunk(8).fields) {
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(chunk, exact);
    options.fields = fields;
    make_store(volume, folder / "s", options);
    const StoreReader store(folder / "s");
    const BisectionOracle oracle(
        volume.nodes(), [&](const Int3& p) { return volume.at(p); }, volume.spacing_);
    double size = 0;
    for (std::int64_t i = 0; i < volume.nodes().product(); ++i) {
        const double v = volume.at(volume.nodes().unlinear(i));
        size = std::isfinite(v) ? std::max(size, std::fabs(v)) : size;
    }
    Comparison c;
    for (const Field field : fields) {
        const auto stored = exported(store, field, folder / "field.raw");
        // The largest number that is rounded: a value times the factor of the node.
        double most = indicator_of(field) >= Indicator::normal_jump ? 1 : size;
        for (const auto& [key, node] : oracle.nodes()) {
            const double v = node.of(field);
            most = std::isfinite(v) ? std::max(most, v) : most;
        }
        const double rounding = 1e-6 * most;
        const bool loose = indicator_of(field) == Indicator::deviation;
        const auto agrees = [&](double value, double exact_value) {
            if (std::isinf(exact_value)) {
                return std::isinf(value);
            }
            // What is passed from level to level is rounded up to binary32, 2^-24 each time.
            const double carried = exact_value * (1 + 1e-6);
            return value >= exact_value - rounding * (loose ? 1 : 1e-6) &&
                   (loose || value <= carried * (1 + above) + rounding * (exact ? 1 : 1e-6));
        };
        std::vector<bool> seen(stored.size());
        c.compared = 0;
        for (const auto& [key, node] : oracle.nodes()) {
            const Int3 p{key[0], key[1], key[2]};
            if (max(p, volume.nodes() - Int3{1, 1, 1}) != volume.nodes() - Int3{1, 1, 1}) {
                continue;
            }
            const auto i = static_cast<std::size_t>(volume.nodes().linear(p));
            seen[i] = true;
            ++c.compared;
            const double value = node.of(field);
            const bool good = agrees(stored[i], value);
            if (!good && c.wrong[field] == 0) {
                UNSCOPED_INFO(name_of(field) << " at " << p.x << " " << p.y << " " << p.z
                                             << ": stored " << stored[i] << ", exact " << value);
            }
            c.wrong[field] += good ? 0 : 1;
            if (field == Field::deviation_bar && value > 0 && std::isfinite(value)) {
                c.ratio_sum += static_cast<double>(stored[i]) / value;
                ++c.ratios;
            }
        }
        for (std::size_t i = 0; i < seen.size(); ++i) {
            c.extra_nodes += !seen[i] && stored[i] != 0 ? 1 : 0;
        }
    }
    return c;
}

template <class T>
void require_agreement(const Int3& n, int chunk, const std::function<T(const Int3&)>& f,
                       const std::vector<Field>& fields = with_chunk(8).fields,
                       const Double3& spacing = {1, 1, 1}) {
    CAPTURE(n.x, n.y, n.z, chunk);
    for (const bool exact : {true, false}) {
        FunctionVolume<T> volume(n, f);
        volume.spacing_ = spacing;
        const Comparison c = compare(volume, chunk, exact, exact ? 1e-6 : 0x1p-5, fields);
        CAPTURE(exact);
        CHECK((c.compared > 0) == (std::max({n.x, n.y, n.z}) > 2));
        for (const auto& [field, count] : c.wrong) {
            CAPTURE(name_of(field));
            CHECK(count == 0);
        }
        CHECK(c.extra_nodes == 0);
        if (exact && n == Int3{33, 33, 33}) {
            CHECK(c.ratio_sum / static_cast<double>(c.ratios) <= 1.05);
        }
    }
}

float noise_f(const Int3& p) {
    return static_cast<float>(noise(p));
}
float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}

}  // namespace

TEST_CASE("indicators agree with an explicit recursive bisection on 33^3") {
    require_agreement<float>({33, 33, 33}, 8, noise_f);
    require_agreement<float>({33, 33, 33}, 16, smooth_f);
    require_agreement<float>({33, 33, 33}, 64, noise_f);
}

TEST_CASE("indicators agree with an explicit recursive bisection on odd sizes") {
    for (const Int3& n :
         {Int3{2, 2, 2}, Int3{3, 2, 5}, Int3{9, 17, 6}, Int3{20, 5, 11}, Int3{2, 2, 40}}) {
        require_agreement<float>(n, 8, noise_f);
    }
}

TEST_CASE("indicators agree with an explicit recursive bisection for every value type") {
    const Int3 n{13, 10, 18};
    require_agreement<std::uint8_t>(
        n, 8, [](const Int3& p) { return static_cast<std::uint8_t>(256 * noise(p)); });
    require_agreement<std::int16_t>(
        n, 8, [](const Int3& p) { return static_cast<std::int16_t>(65535 * noise(p) - 32768); });
    require_agreement<std::int32_t>(n, 8, [](const Int3& p) {
        return noise(p) < 0.5 ? std::numeric_limits<std::int32_t>::min()
                              : std::numeric_limits<std::int32_t>::max();
    });
    require_agreement<double>(n, 8, [](const Int3& p) { return 1e30 * smooth(p); });
}

TEST_CASE("every indicator agrees with the recursion, with spacing and on borders") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{12, 9, 19}, Int3{2, 3, 5}}) {
        require_agreement<float>(n, 8, noise_f, node_indicators(), {1, 1, 1});
        require_agreement<float>(n, 8, smooth_f, node_indicators(), {0.5, 1.25, 3});
    }
    require_agreement<std::uint8_t>(
        {11, 14, 9}, 8, [](const Int3& p) { return static_cast<std::uint8_t>(6 * noise(p)); },
        node_indicators(), {1, 1, 2});
}

TEST_CASE("every indicator agrees with the recursion on triangles and edges if axes are flat") {
    for (const Int3& n : {Int3{33, 33, 1}, Int3{20, 11, 1}, Int3{1, 18, 13}, Int3{12, 1, 25},
                          Int3{40, 1, 1}, Int3{1, 37, 1}, Int3{1, 1, 21}, Int3{2, 3, 1}}) {
        require_agreement<float>(n, 8, noise_f, node_indicators());
        require_agreement<float>(n, 16, smooth_f, node_indicators(), {0.5, 1.25, 3});
    }
}

TEST_CASE("every diamond that contains missing data is refined to the finest level") {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float inf = std::numeric_limits<float>::infinity();
    require_agreement<float>({17, 17, 17}, 8, [&](const Int3& p) {
        return p == Int3{5, 9, 12} || p == Int3{0, 0, 3} ? nan
               : p == Int3{16, 8, 8}                     ? -inf
                                                         : smooth_f(p);
    });
    require_agreement<float>({9, 9, 9}, 8, [&](const Int3&) { return nan; });
    require_agreement<float>(
        {17, 10, 9}, 8,
        [&](const Int3& p) {
            return p == Int3{5, 9, 4} || p.x == 12 ? nan : smooth_f(p);
        },
        node_indicators());
    require_agreement<float>(
        {17, 10, 1}, 8, [&](const Int3& p) { return p.x == 5 && p.y > 6 ? nan : noise_f(p); },
        node_indicators());
}

TEST_CASE(
    "normal is the component of the gradient's jump normal to the children's common face, "
    "normal_jump its length") {
    // Two triangles, bisected from the centre to (2, 0) and (0, 2). The gradients in the children
    // of the first are (1, 0) and (2, 1), those in the second are mirrored; the normal of both
    // faces is (1, 1) / sqrt 2. The four edges' midpoints do not matter.
    const std::array<float, 9> values{0, 1, 2, 1, 1, 3, 2, 3, 4};
    FunctionVolume<float> volume({3, 3, 1}, [&](const Int3& p) {
        return values.at(static_cast<std::size_t>(p.x + 3 * p.y));
    });
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(8, true);
    options.fields = {Field::normal_jump_bar, Field::normal_bar};
    make_store(volume, folder / "s", options);
    const StoreReader store(folder / "s");
    const double jump = std::sqrt(2 - 4 / std::sqrt(5.0));
    const double component = (3 / std::sqrt(5.0) - 1) / std::sqrt(2.0);
    CHECK(static_cast<double>(exported(store, Field::normal_jump_bar, folder / "n.raw").at(4)) ==
          Approx(jump));
    CHECK(static_cast<double>(exported(store, Field::normal_bar, folder / "c.raw").at(4)) ==
          Approx(component));
}

TEST_CASE("half of eta plus does not bound the deviation, but eta plus does") {
    // Section 5 of the paper prints beta_0 = eta_plus / 2. With U = 0 except at one node in the
    // middle of a refinement edge, U reaches delta there, and the printed bound is delta / 2.
    FunctionVolume<float> volume({3, 3, 3}, [](const Int3& p) {
        return p == Int3{1, 1, 1} ? 1.0F : 0.0F;
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8, true));
    const StoreReader store(folder / "s");
    const auto plus = exported(store, Field::linf_plus, folder / "p.raw");
    const float at_centre = plus[static_cast<std::size_t>(Int3{3, 3, 3}.linear({1, 1, 1}))];
    const double reached = 1.0;
    CHECK(reached > 0 + static_cast<double>(at_centre) / 2);
    CHECK(reached <= 0 + static_cast<double>(at_centre));
}

TEST_CASE("eta bar does not bound the deviation, deviation bar does") {
    // Takagi's function along x: every level of the lattice adds at most 1, which eta bar detects,
    // and the sum reaches 10/3 over the five levels, which it does not detect. Along z there is a
    // slope that no indicator detects.
    const double error = 1.25;
    const auto worst = [&](ErrorIndicator indicator) {
        FunctionVolume<float> volume({33, 33, 33}, [](const Int3& p) {
            double sum = 0.25 * static_cast<double>(p.z);
            for (std::int64_t period = 2; period <= 32; period *= 2) {
                const std::int64_t phase = p.x % period;
                sum += 2.0 * static_cast<double>(std::min(phase, period - phase)) /
                       static_cast<double>(period);
            }
            return static_cast<float>(sum);
        });
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(16));
        const StoreReader store(folder / "s");
        double most = 0;
        for (const double iso : {3.1, 4.2}) {
            Extraction options;
            options.iso = iso;
            options.error = error;
            options.indicator = indicator;
            extract(store, folder / "m.ply", options, silent_progress());
            const Mesh mesh = read_mesh(folder / "m.ply");
            for (const auto& t : mesh.triangles) {
                for (int i = 0; i <= 4; ++i) {
                    for (int j = 0; i + j <= 4; ++j) {
                        Double3 p{};
                        for (std::size_t a = 0; a < 3; ++a) {
                            p[a] = (static_cast<double>(i) * mesh.vertices[t[0]][a] +
                                    static_cast<double>(j) * mesh.vertices[t[1]][a] +
                                    static_cast<double>(4 - i - j) * mesh.vertices[t[2]][a]) /
                                   4.0;
                        }
                        most = std::max(most, std::fabs(fine_value(volume, p) - iso));
                    }
                }
            }
        }
        return most;
    };
    CHECK(worst(ErrorIndicator::estimate) > error);
    CHECK(worst(ErrorIndicator::deviation) <= error + 1e-5);
    CHECK(worst(ErrorIndicator::plus) <= error + 1e-5);
}

TEST_CASE("check verifies saturation, injection and bounds for every chunk size") {
    FunctionVolume<float> volume({40, 33, 27}, smooth_f);
    for (const int chunk : {8, 16, 32, 64}) {
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(chunk));
        CheckOptions options;
        options.source = &volume;
        const CheckReport r = check(StoreReader(folder / "s"), options, silent_progress());
        CHECK(r.failures == 0);
        CHECK(r.cubes > 0);
        CHECK(r.nodes > 0);
    }
}

// Hidden: with ISONEST_CROPS naming a folder of NxNxN crops of real volumes (NAME-N.f32, raw
// float32), `isonest_tests "[crops]"` compares all indicators with the recursion and prints the
// deviation's ratio.
TEST_CASE(
    "indicators agree with the recursion, and the deviation is tight, on crops of real volumes",
    "[.][crops]") {
    const char* const folder = std::getenv("ISONEST_CROPS");
    REQUIRE(folder != nullptr);
    int seen = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        const std::string bytes = read_file(entry.path());
        const auto n = static_cast<std::int64_t>(
            std::lround(std::cbrt(static_cast<double>(bytes.size()) / 4.0)));
        REQUIRE(bytes.size() == static_cast<std::size_t>(4 * n * n * n));
        FunctionVolume<float> volume({n, n, n}, [&](const Int3& p) {
            float v = 0;
            std::memcpy(&v, bytes.data() + 4 * (Int3{n, n, n}).linear(p), 4);
            return v;
        });
        for (const int chunk : {16, 32, 64}) {
            for (const bool exact : {true, false}) {
                const Comparison c = compare(volume, chunk, exact, exact ? 1e-6 : 0x1p-5);
                const double ratio = c.ratio_sum / static_cast<double>(c.ratios);
                std::printf("%-28s chunk %2d %s  nodes %zu  mean deviation / exact %.4f\n",
                            entry.path().filename().c_str(), chunk, exact ? "exact " : "16 bit",
                            c.compared, ratio);
                for (const auto& wrong : c.wrong) {
                    CHECK(wrong.second == 0);
                }
                CHECK(c.extra_nodes == 0);
                CHECK((!exact || ratio <= 1.05));
                ++seen;
                if (n > 40 && exact) {
                    break;  // the recursion is slow; one run is enough for the ratio
                }
            }
            if (n > 40) {
                break;
            }
        }
    }
    CHECK(seen > 0);
}

namespace {

/// max |U - U_T| over the nodes of the six tetrahedra of a cube, in higher precision than the
/// values.
template <class T>
long double exact_difference(const FunctionVolume<T>& volume, const Int3& cube, std::int64_t edge) {
    long double most = 0;
    const Int3 last = volume.nodes() - Int3{1, 1, 1};
    const auto value = [&](const Int3& p) { return static_cast<long double>(volume.at(p)); };
    for (int order = 0; order < 6; ++order) {
        const Tetrahedron t = kuhn_tetrahedron(cube, edge, order);
        const auto& axes = kAxisOrders[static_cast<std::size_t>(order)];
        for (std::int64_t i = 0; i < (edge + 1) * (edge + 1) * (edge + 1); ++i) {
            const Int3 p = cube * edge + (Int3{edge + 1, edge + 1, edge + 1}).unlinear(i);
            std::array<long double, 3> d{};
            for (std::size_t a = 0; a < 3; ++a) {
                d[a] = static_cast<long double>(std::abs(p[axes[a]] - t.v[0][axes[a]])) /
                       static_cast<long double>(edge);
            }
            if (d[0] < d[1] || d[1] < d[2] || max(p, last) != last) {
                continue;
            }
            // Differences are computed first: they need few bits.
            const long double u0 = value(min(t.v[0], last));
            const long double linear = (value(min(t.v[1], last)) - u0) * (d[0] - d[1]) +
                                       (value(min(t.v[2], last)) - u0) * (d[1] - d[2]) +
                                       (value(min(t.v[3], last)) - u0) * d[2];
            most = std::max(most, std::fabs((value(p) - u0) - linear));
        }
    }
    return most;
}

}  // namespace

TEST_CASE("no stored bound is below the exact one when the means of values are rounded") {
    for (const double step : {2.0, 6.0, 1e16}) {
        for (const bool exact : {true, false}) {
            FunctionVolume<double> volume({19, 17, 18}, [&](const Int3& p) {
                return -1e16 + step * std::floor(4 * std::fabs(noise(p)));
            });
            const TemporaryFolder folder;
            make_store(volume, folder / "s", with_chunk(8, exact));
            const StoreReader store(folder / "s");
            ChunkCache cache(store, 1U << 24U);
            NodeSampler sampler(cache);
            std::size_t wrong = 0;
            for (int level = 1; level <= 4; ++level) {
                const std::int64_t edge = std::int64_t{1} << level;
                const Int3 cells = store.layout().lattice().cells_at(level);
                for (std::int64_t i = 0; i < cells.product(); ++i) {
                    const Int3 cube = cells.unlinear(i);
                    const long double most = exact_difference(volume, cube, edge);
                    const Int3 centre = cube * edge + Int3{edge / 2, edge / 2, edge / 2};
                    for (const Field field : {Field::deviation_bar, Field::linf_plus}) {
                        wrong += sampler.indicator(centre, field) < most ? 1 : 0;
                    }
                }
            }
            CAPTURE(step, exact);
            CHECK(wrong == 0);
            CHECK(check(store, {}, silent_progress()).failures == 0);
        }
    }
}
