// The histogram and the numbers of cubes and nodes are those of a direct count over the values.
#include "query/statistics/histogram.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <limits>
#include <numeric>
#include <random>

#include <isonest/error.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Each value is in the last bin that does not begin above it, and bins ascend.
template <class T>
void require_bins(const std::vector<T>& values) {
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    const ValueBins bins(value_type_of<T>, static_cast<double>(*low), static_cast<double>(*high));
    CAPTURE(name_of(value_type_of<T>), *low, *high);
    REQUIRE(bins.count() >= 1);
    REQUIRE(bins.count() <= kMaxBins);
    REQUIRE(bins.low.front() == static_cast<double>(*low));
    REQUIRE(std::is_sorted(bins.low.begin(), bins.low.end()));
    for (const double l : bins.low) {
        REQUIRE(std::isfinite(l));
    }
    const BinFinder bin_of(bins);
    const auto check = [&](double v) {
        int k = 0;
        for (int i = 0; i < bins.count(); ++i) {
            k = v >= bins.low[i] ? i : k;
        }
        REQUIRE(bin_of(v) == k);
    };
    for (const T v : values) {
        check(static_cast<double>(v));
    }
    for (const double l : bins.low) {
        check(l);
        check(bins.integer ? l - 1 : std::nextafter(l, -1e308));
    }
    check(std::numeric_limits<double>::infinity());
    check(-std::numeric_limits<double>::infinity());
    if (bins.integer) {
        const double width = bins.count() > 1 ? bins.low[1] - bins.low[0] : bins.end - bins.low[0];
        CHECK(width == std::floor(width));
        CHECK((width == 1 || static_cast<double>(*high) - static_cast<double>(*low) >= kMaxBins));
        CHECK(bins.count() > (width == 1 ? 0 : kMaxBins / 2));
        CHECK(bins.end > static_cast<double>(*high));
    }
}

template <class T>
void require_bins_of_ranges() {
    using Limits = std::numeric_limits<T>;
    const T low = Limits::lowest();
    const T high = Limits::max();
    require_bins<T>({low, high, T(0), T(1), T(high / 2), T(low / 2)});
    require_bins<T>({T(5)});
    require_bins<T>({low, T(low + 1)});
    require_bins<T>({T(high - 1), high});
    require_bins<T>({T(0), Limits::denorm_min() > 0 ? Limits::denorm_min() : T(1)});
    std::mt19937_64 random(3);
    for (const double span : {3.0, 100.0, 255.0, 256.0, 257.0, 300.0, 511.0, 512.0, 1000.0, 1e6}) {
        const auto most = static_cast<double>(high);
        std::vector<T> values{T(0), static_cast<T>(std::min(span, most))};
        for (int i = 0; i < 200; ++i) {
            values.push_back(
                static_cast<T>(std::min(span, most) * std::generate_canonical<double, 53>(random)));
        }
        require_bins<T>(values);
    }
}

/// The expected counts, computed for every node and cube.
struct Walked {
    std::vector<std::uint64_t> nodes;
    std::vector<std::uint64_t> cubes;
    std::uint64_t missing = 0;
};

template <class T>
Walked walk(const FunctionVolume<T>& volume, const ValueBins& bins, std::int64_t stride,
            std::int64_t edge) {
    Walked w{std::vector<std::uint64_t>(bins.low.size()),
             std::vector<std::uint64_t>(bins.low.size()), 0};
    const Int3 n = volume.nodes();
    const Int3 sampled = ceil_div(n, Int3{1, 1, 1} * stride);
    for (std::int64_t i = 0; i < sampled.product(); ++i) {
        const double v = volume.at(sampled.unlinear(i) * stride);
        if (!std::isfinite(v)) {
            ++w.missing;
            continue;
        }
        const auto above = std::upper_bound(bins.low.begin(), bins.low.end(), v);
        ++w.nodes[static_cast<std::size_t>(above - bins.low.begin() - 1)];
    }
    const Int3 cells = max(ceil_div(n - Int3{1, 1, 1}, Int3{1, 1, 1} * edge), {1, 1, 1});
    for (std::int64_t c = 0; c < cells.product(); ++c) {
        const Int3 first = cells.unlinear(c) * edge;
        const Int3 count = min(Int3{1, 1, 1} * (edge + 1), max(n - first, {1, 1, 1}));
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (std::int64_t i = 0; i < count.product(); ++i) {
            const double v = volume.at(first + count.unlinear(i));
            if (edge > 1 ? !std::isnan(v) : std::isfinite(v)) {  // as in the stored ranges
                low = std::min(low, v);
                high = std::max(high, v);
            }
        }
        for (std::size_t k = 0; k < bins.low.size(); ++k) {
            w.cubes[k] += k > 0 && low < bins.low[k] && bins.low[k] <= high ? 1 : 0;
        }
    }
    return w;
}

template <class T>
void require_counts(const Int3& n, const std::function<T(const Int3&)>& f) {
    FunctionVolume<T> volume(n, f);
    CAPTURE(n.x, n.y, n.z, name_of(value_type_of<T>));
    std::optional<std::vector<SuggestedIsovalue>> suggested;
    for (const int chunk : {8, 16, 64}) {
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(chunk));
        const StoreReader store(folder / "s");
        for (const int level : {0, 1, 2}) {
            if (level > store.layout().lattice().top()) {
                continue;
            }
            for (const int threads : {1, 3}) {
                HistogramOptions options;
                options.level = level;
                options.threads = threads;
                options.memory = std::uint64_t{threads == 1 ? 32U : 512U} << 20U;
                const Histogram h = histogram(store, options, silent_progress());
                const bool ranges = store.layout().has_cube_ranges(kFirstRangeLevel);
                REQUIRE(h.cube_level.has_value() == (level == 0 || ranges));
                const int cube_level = h.cube_level.value_or(0);
                CHECK(cube_level == (level == 0 || !ranges ? 0 : kFirstRangeLevel));
                const Walked w =
                    walk(volume, h.bins, std::int64_t{1} << level, std::int64_t{1} << cube_level);
                CHECK(h.nodes == w.nodes);
                CHECK(h.missing == w.missing);
                CHECK(h.looked == w.missing + std::accumulate(w.nodes.begin(), w.nodes.end(),
                                                              std::uint64_t{0}));
                // Ranges of 4 and 8 bytes are rounded outward.
                if (h.cube_level && (level == 0 || sizeof(T) <= 2)) {
                    CHECK(h.cubes == w.cubes);
                }
                for (std::size_t k = 0; h.cube_level && k < h.cubes.size(); ++k) {
                    CHECK(h.cubes[k] >= w.cubes[k]);
                }
                if (level == 0) {
                    CHECK(suggested.value_or(h.suggested) == h.suggested);
                    suggested = h.suggested;
                }
            }
        }
    }
}

template <class T>
void require_counts_of_shapes() {
    const auto value = [](const Int3& p) {
        constexpr double kMax = 127;  // a value that every type can hold
        return static_cast<T>(std::clamp(100 * noise(p) + 40 * (smooth(p) + 1.3), 0.0, kMax));
    };
    for (const Int3 n : {Int3{17, 17, 17}, Int3{18, 9, 25}, Int3{2, 3, 70}, Int3{40, 33, 1},
                         Int3{1, 20, 17}, Int3{1, 1, 30}, Int3{30, 1, 1}, Int3{1, 1, 1}}) {
        require_counts<T>(n, value);
    }
}

/// The isovalues suggested for a full volume of bytes.
std::vector<double> suggested_for(const std::function<double(const Int3&)>& f, std::int64_t n) {
    FunctionVolume<std::uint8_t> volume({n, n, n}, [&](const Int3& p) {
        return static_cast<std::uint8_t>(std::clamp(std::lround(f(p)), 0L, 255L));
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(16));
    std::vector<double> isovalues;
    for (const SuggestedIsovalue& s :
         histogram(StoreReader(folder / "s"), {}, silent_progress()).suggested) {
        isovalues.push_back(s.isovalue);
    }
    return isovalues;
}

}  // namespace

TEST_CASE("every value is in the last bin that does not begin above it") {
    require_bins_of_ranges<std::uint8_t>();
    require_bins_of_ranges<std::int8_t>();
    require_bins_of_ranges<std::uint16_t>();
    require_bins_of_ranges<std::int16_t>();
    require_bins_of_ranges<std::uint32_t>();
    require_bins_of_ranges<std::int32_t>();
    require_bins_of_ranges<float>();
    require_bins_of_ranges<double>();
    require_bins<double>({1, std::nextafter(1.0, 2.0)});
    CHECK(ValueBins(ValueType::u8, 3, 2).count() == 0);
    CHECK(ValueBins(ValueType::u8, 0, 255).count() == 256);
    CHECK(ValueBins(ValueType::i16, -5, 7).count() == 13);
    CHECK(ValueBins(ValueType::i16, 0, 256).count() == 129);
}

TEST_CASE(
    "counts of nodes and cubes are those of a direct count, for any chunks, threads and memory") {
    require_counts_of_shapes<std::uint8_t>();
    require_counts_of_shapes<std::int16_t>();
    require_counts_of_shapes<std::uint32_t>();
    require_counts_of_shapes<float>();
    require_counts_of_shapes<double>();
}

TEST_CASE("missing values are counted separately, and the extremes of a type are values") {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    const auto holes = [&](const Int3& p) {
        const double h = noise(p, 3);
        return h < 0.2   ? kNan
               : h < 0.3 ? kInfinity
               : h < 0.4 ? -kInfinity
                         : static_cast<float>(noise(p));
    };
    require_counts<float>({19, 18, 17}, holes);
    require_counts<float>({9, 9, 9}, [&](const Int3&) { return kNan; });
    require_counts<float>({9, 9, 9}, [](const Int3&) { return 2.5F; });
    require_counts<std::int8_t>({9, 9, 9}, [](const Int3&) { return std::int8_t{-3}; });
    const auto ends = [](auto type) {
        using T = decltype(type);
        require_counts<T>({18, 17, 16}, [](const Int3& p) {
            return noise(p) < 0.3   ? std::numeric_limits<T>::lowest()
                   : noise(p) < 0.6 ? std::numeric_limits<T>::max()
                                    : static_cast<T>(p.x);
        });
    };
    ends(std::int32_t{});
    ends(std::uint32_t{});
    ends(float{});
    ends(double{});
}

TEST_CASE("isovalues are suggested between the materials of a blurred, noisy volume") {
    // A ball with value 200 in a shell with 120 in air with 30; the boundaries are four nodes wide.
    const auto material = [](const Int3& p) {
        const auto square = [](std::int64_t v) { return static_cast<double>((v - 24) * (v - 24)); };
        const double r = std::sqrt(square(p.x) + square(p.y) + square(p.z));
        const auto step = [&](double at) { return std::clamp((at - r) / 4 + 0.5, 0.0, 1.0); };
        return 30 + 90 * step(20) + 80 * step(11) + 8 * (noise(p) + noise(p, 9) - 1);
    };
    std::vector<double> found = suggested_for(material, 49);
    REQUIRE(found.size() == 2);
    std::sort(found.begin(), found.end());
    CHECK(found[0] == Approx(75).margin(25));
    CHECK(found[1] == Approx(160).margin(25));
}

TEST_CASE(
    "a mask gets the isovalue in its middle, and nothing is suggested if there is no surface") {
    const auto mask = [](const Int3& p) { return p.x + p.y < 9 ? 0.0 : 255.0; };
    CHECK(suggested_for(mask, 17) == std::vector<double>{127.5});
    const auto two = [](const Int3& p) { return p.x + p.y < 9 ? 0.0 : 1.0; };
    CHECK(suggested_for(two, 17) == std::vector<double>{0.5});
    CHECK(suggested_for([](const Int3&) { return 7.0; }, 17).empty());
    // A ramp is equally sharp everywhere: one of its isovalues is suggested, not all.
    CHECK(suggested_for([](const Int3& p) { return 5.0 * p.x; }, 17).size() == 1);
}

TEST_CASE(
    "a histogram can be cancelled, and reports too little memory or a level that does not exist") {
    FunctionVolume<std::uint8_t> volume(
        {33, 33, 33}, [](const Int3& p) { return static_cast<std::uint8_t>(256 * noise(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    const auto kind_of = [&](const HistogramOptions& options, Progress& progress) {
        try {
            histogram(store, options, progress);
        } catch (const Error& error) {
            return std::optional(error.kind());
        }
        return std::optional<ErrorKind>();
    };
    struct Stop : Progress {
        [[nodiscard]] bool cancelled() const override { return true; }
    } stop;
    CHECK(kind_of({}, stop) == ErrorKind::cancelled);
    CHECK(kind_of({.memory = 1}, silent_progress()) == ErrorKind::limit);
    CHECK(kind_of({.level = 6}, silent_progress()) == ErrorKind::not_found);
    CHECK(!kind_of({.level = 5}, silent_progress()));
}
