// Rounding of values: which step a tolerance gives, and what is stored.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <random>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/memory_volume.h>
#include <isonest/tolerance.h>

#include "preprocess/sources/wrapping/rounded_source.h"
#include "store/container/reader.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::array kTypes{ValueType::u8,  ValueType::i8,  ValueType::u16, ValueType::i16,
                            ValueType::u32, ValueType::i32, ValueType::f32, ValueType::f64};

/// Values of all sizes, with the extremes of the type.
template <class T>
std::vector<T> values_of_all_sizes() {
    std::mt19937_64 random(3);
    std::vector<T> values{T{0}, std::numeric_limits<T>::max(), std::numeric_limits<T>::lowest()};
    if constexpr (std::is_floating_point_v<T>) {
        const T inf = std::numeric_limits<T>::infinity();
        values.insert(values.end(), {inf, -inf, std::numeric_limits<T>::quiet_NaN(),
                                     static_cast<T>(-0.0), std::numeric_limits<T>::denorm_min()});
        std::uniform_real_distribution<double> exponent(-40, 40);
        for (int i = 0; i < 20000; ++i) {
            const double size = std::exp2(exponent(random));
            values.push_back(static_cast<T>((i % 2 != 0 ? -size : size)));
        }
    } else {
        for (int i = 0; i < 20000; ++i) {
            values.push_back(static_cast<T>(random() >> (random() % 64)));
        }
    }
    return values;
}

template <class Call>
std::optional<ErrorKind> kind_of(const Call& call) {
    try {
        call();
    } catch (const Error& error) {
        return error.kind();
    }
    return std::nullopt;
}

/// A smooth function of x with noise of this deviation.
std::vector<float> noisy(std::int64_t n, double deviation, double steep) {
    std::mt19937 random(5);
    std::normal_distribution<double> noise(0, deviation);
    std::vector<float> values;
    for (std::int64_t i = 0; i < n * n * n; ++i) {
        const auto x = static_cast<double>(i % n);
        const double added = deviation > 0 ? noise(random) : 0;
        values.push_back(static_cast<float>(steep * std::sin(0.1 * x) + added));
    }
    return values;
}

ValueSurvey survey_of(const std::vector<float>& values, std::int64_t n, std::uint64_t memory) {
    MemoryVolume volume(values.data(), ValueType::f32, {n, n, n});
    return survey_values(volume, WithinNoise{}, memory);
}

}  // namespace

TEST_CASE("a tolerance of 0, or below 1 for integers, rounds nothing") {
    for (const ValueType type : kTypes) {
        CHECK(rounding_of(WithinValue{0}, type).none());
        CHECK(rounding_of(WithinRangePart{0}, type, {0, 100}).none());
        CHECK(rounding_of(WithinRangePart{0.5}, type, {7, 7}).none());
        CHECK(rounding_of(WithinNoise{}, type, {0, 100, 0}).none());
        if (type != ValueType::f32 && type != ValueType::f64) {
            CHECK(rounding_of(WithinValue{0.99}, type).none());
            CHECK(rounding_of(WithoutLowBits{0}, type).none());
        }
    }
}

TEST_CASE("the step is a power of two for floating-point values, and where bytes gain by it") {
    CHECK(rounding_of(WithinValue{0.3}, ValueType::f32) == DataRounding{0.25, 0.5});
    CHECK(rounding_of(WithinValue{0.25}, ValueType::f64) == DataRounding{0.25, 0.5});
    CHECK(rounding_of(WithinRangePart{0.005}, ValueType::f32, {-50, 150}) == DataRounding{1, 2});
    CHECK(rounding_of(WithinValue{2}, ValueType::u8) == DataRounding{2, 5});
    CHECK(rounding_of(WithinValue{3}, ValueType::u16) == DataRounding{3, 7});
    CHECK(rounding_of(WithinValue{2}, ValueType::u16) == DataRounding{2, 4});
    CHECK(rounding_of(WithinValue{20}, ValueType::i16) == DataRounding{16, 32});
    CHECK(rounding_of(WithoutLowBits{4}, ValueType::u16) == DataRounding{8, 16});
    CHECK(rounding_of(WithinNoise{}, ValueType::u16, {0, 9, 6.5}) == DataRounding{3, 7});
}

TEST_CASE("impossible tolerances are refused") {
    const double inf = std::numeric_limits<double>::infinity();
    for (const double value : {-1.0, inf, std::nan("")}) {
        CHECK(kind_of([&] { rounding_of(WithinValue{value}, ValueType::f32); }) ==
              ErrorKind::invalid_argument);
    }
    CHECK(kind_of([] { rounding_of(WithinValue{255}, ValueType::u8); }) ==
          ErrorKind::invalid_argument);
    CHECK(kind_of([] {
              rounding_of(WithinRangePart{1.01}, ValueType::u8, {0, 9});
          }) == ErrorKind::invalid_argument);
    CHECK(kind_of([] { rounding_of(WithoutLowBits{8}, ValueType::u8); }) ==
          ErrorKind::invalid_argument);
    CHECK(kind_of([] { rounding_of(WithoutLowBits{2}, ValueType::f32); }) ==
          ErrorKind::invalid_argument);
}

TEST_CASE("values become multiples of the step within the tolerance, and rounding twice is once") {
    for (const ValueType type : kTypes) {
        for (const double tolerance : {1e-6, 0.01, 1.0, 2.0, 3.0, 5.0, 100.0}) {
            const DataRounding rounding = rounding_of(WithinValue{tolerance}, type);
            if (rounding.none()) {
                continue;
            }
            CHECK(rounding.tolerance <= tolerance);
            dispatch(type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                const std::vector<T> given = values_of_all_sizes<T>();
                std::vector<T> rounded = given;
                const auto round = [&] {
                    round_values(type, rounding, rounded.size(),
                                 reinterpret_cast<std::byte*>(rounded.data()));
                };
                round();
                std::size_t faults = 0;
                for (std::size_t i = 0; i < given.size(); ++i) {
                    const auto before = static_cast<long double>(given[i]);
                    const auto after = static_cast<long double>(rounded[i]);
                    if (!std::isfinite(before)) {
                        faults += std::memcmp(&given[i], &rounded[i], sizeof(T)) != 0 ? 1U : 0U;
                        continue;
                    }
                    const bool at_end = rounded[i] == std::numeric_limits<T>::max() ||
                                        rounded[i] == std::numeric_limits<T>::lowest();
                    const bool is_multiple =
                        std::remainder(after, static_cast<long double>(rounding.step)) == 0;
                    faults += std::fabs(after - before) > rounding.tolerance ? 1U : 0U;
                    faults += is_multiple || at_end ? 0U : 1U;
                    faults += after == 0 && std::signbit(after) && before != 0 ? 1U : 0U;
                }
                CHECK(faults == 0);
                const std::vector<T> once = rounded;
                round();
                CHECK(std::memcmp(once.data(), rounded.data(), once.size() * sizeof(T)) == 0);
            });
        }
    }
}

TEST_CASE("noise is found beside a smooth function, and a smooth function is no noise") {
    constexpr std::int64_t kN = 48;
    for (const double deviation : {0.5, 3.0}) {
        const ValueSurvey survey = survey_of(noisy(kN, deviation, 100), kN, 1U << 20U);
        CHECK(survey.noise == Approx(deviation).epsilon(0.03));
        CHECK(survey.noise == survey_of(noisy(kN, deviation, 100), kN, 1U << 10U).noise);
    }
    CHECK(survey_of(noisy(kN, 0, 100), kN, 1U << 20U).noise == 0);
    // A background of zeros, such as that of a masked scan, does not hide the noise of the rest.
    std::vector<float> masked = noisy(kN, 3, 100);
    std::fill(masked.begin(), masked.begin() + static_cast<std::ptrdiff_t>(masked.size() / 4 * 3),
              0.0F);
    CHECK(survey_of(masked, kN, 1U << 20U).noise == Approx(3).epsilon(0.05));
    // A nearly empty volume: what is left may be structure as well.
    std::fill(masked.begin(), masked.end() - static_cast<std::ptrdiff_t>(masked.size() / 20), 0.0F);
    CHECK(survey_of(masked, kN, 1U << 20U).noise == 0);
    CHECK(survey_of(std::vector<float>(8, 1.0F), 2, 1U << 20U).noise == 0);
}

TEST_CASE("a survey finds the range of finite values") {
    std::vector<float> values(27, 2.0F);
    values[3] = -5;
    values[20] = 9;
    values[21] = std::numeric_limits<float>::infinity();
    values[22] = std::numeric_limits<float>::quiet_NaN();
    MemoryVolume volume(values.data(), ValueType::f32, {3, 3, 3});
    const ValueSurvey survey = survey_values(volume, WithinRangePart{0.1}, 1U << 20U);
    CHECK(survey.min == -5);
    CHECK(survey.max == 9);
    CHECK(survey.noise == 0);
}

TEST_CASE("a rounded store is the store of rounded values, but for its header") {
    const TemporaryFolder dir;
    constexpr std::int64_t kN = 41;
    const std::vector<float> given = noisy(kN, 1, 20);
    const DataRounding rounding = rounding_of(WithinValue{0.4}, ValueType::f32);
    std::vector<float> rounded = given;
    round_values(ValueType::f32, rounding, rounded.size(),
                 reinterpret_cast<std::byte*>(rounded.data()));
    const auto made = [&](const std::vector<float>& values, const DataRounding& how,
                          const char* name, std::uint64_t memory) {
        MemoryVolume volume(values.data(), ValueType::f32, {kN, kN, kN});
        PreprocessOptions options = with_chunk(16, false);
        options.rounding = how;
        options.memory = memory;
        options.threads = memory % 3 == 0 ? 1 : 2;
        preprocess(volume, dir / name, options);
        return StoreReader(dir / name);
    };
    const StoreReader plain = made(rounded, {}, "plain.isonest", 256U << 20U);
    const StoreReader tolerant = made(given, rounding, "tolerant.isonest", 256U << 20U);
    CHECK(plain.layout().header().rounding.none());
    CHECK(tolerant.layout().header().rounding == rounding);
    CHECK(tolerant.version() == FormatVersion{2, 13});
    for (const ArrayInfo& array : plain.layout().arrays()) {
        for (std::int64_t i = 0; i < array.grid.product(); ++i) {
            const Int3 chunk = array.grid.unlinear(i);
            const ChunkRow a = plain.row(array, chunk);
            const ChunkRow b = tolerant.row(array, chunk);
            REQUIRE(a.checksum == b.checksum);
            REQUIRE(a.min == b.min);
            REQUIRE(a.max == b.max);
        }
    }
    const StoreReader other = made(given, rounding, "other.isonest", 192U << 20U);
    CHECK(read_file(dir / "tolerant.isonest") == read_file(dir / "other.isonest"));
}

TEST_CASE("a rounding that is not one of the type is refused") {
    const TemporaryFolder dir;
    const std::vector<std::uint16_t> values(125);
    const auto kind = [&](const DataRounding& rounding) {
        MemoryVolume volume(values.data(), ValueType::u16, {5, 5, 5});
        PreprocessOptions options;
        options.rounding = rounding;
        return kind_of([&] { preprocess(volume, dir / "s.isonest", options); });
    };
    CHECK(kind({1, 2.5}) == ErrorKind::invalid_argument);
    CHECK(kind({1, 5}) == ErrorKind::invalid_argument);
    CHECK(kind({0, 1}) == ErrorKind::invalid_argument);
    CHECK(kind({9, 5}) == ErrorKind::invalid_argument);
}
