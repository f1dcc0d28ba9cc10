// Source for the noise: D. L. Donoho, I. M. Johnstone, "Ideal spatial adaptation by wavelet
// shrinkage", Biometrika 81 (1994): the noise's standard deviation is the median of the finest
// coefficients' absolute values over 0.6745. The coefficients here are the offsets of level 1 along
// x (preprocess/METHOD.md). A smooth function has offsets, too, but its higher differences are
// smaller, while those of independent noise, over the square root of the sum of their squared
// weights, are as large: so the smallest estimate of differences of order 2, 4 and 6 is taken.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/tolerance.h>

namespace isonest {
namespace {

constexpr double kMedianOfNormal = 0.6745;  ///< of the absolute value, for a deviation of 1
constexpr double kPartOfNoise = 0.5;
/// Fewer differences say nothing about the noise. In a volume that is nearly empty, most of them
/// are at the borders of thin structures.
constexpr std::uint64_t kMinDifferences = 1000;
constexpr double kMinShare = 0.1;
/// Below this part of the range it is rounding rather than noise.
constexpr double kMinNoise = 1e-5;

/// Counts positive numbers by the upper 16 bits of their binary32, so to within 1 %, in a fixed
/// amount of memory.
class Magnitudes {
  public:
    void add(double number) {
        ++counts_[std::bit_cast<std::uint32_t>(static_cast<float>(number)) >> kLowBits];
        ++all_;
    }
    [[nodiscard]] std::uint64_t all() const { return all_; }
    [[nodiscard]] double median() const {
        std::uint64_t below = 0;
        std::uint32_t code = 0;
        while (below + counts_[code] <= all_ / 2) {
            below += counts_[code++];
        }
        return static_cast<double>(std::bit_cast<float>(code << kLowBits));
    }

  private:
    static constexpr unsigned kLowBits = 16;
    static constexpr std::size_t kCodes = std::size_t{1} << 15U;
    std::vector<std::uint64_t> counts_ = std::vector<std::uint64_t>(kCodes);
    std::uint64_t all_ = 0;
};

/// Differences of one order of neighbouring values.
template <std::size_t kCount>
class Differences {
  public:
    explicit Differences(const std::array<double, kCount>& weights) : weights_(weights) {
        double squares = 0;
        for (const double weight : weights) {
            squares += weight * weight;
        }
        scale_ = 1 / std::sqrt(squares);
    }
    /// At every second value. Where all values are equal there was no measurement (the background
    /// of a masked volume), so these say nothing about the noise.
    template <class T>
    void add(std::span<const T> row) {
        for (std::size_t i = 0; i + kCount <= row.size(); i += 2) {
            double sum = 0;
            bool constant = true;
            for (std::size_t k = 0; k < kCount; ++k) {
                sum += weights_[k] * static_cast<double>(row[i + k]);
                constant = constant && row[i + k] == row[i];
            }
            ++seen_;
            if (!constant && std::isfinite(sum)) {
                magnitudes_.add(std::fabs(sum) * scale_);
            }
        }
    }
    /// Infinite if there are too few.
    [[nodiscard]] double noise() const {
        const auto all = static_cast<double>(magnitudes_.all());
        const bool enough =
            magnitudes_.all() >= kMinDifferences && all >= kMinShare * static_cast<double>(seen_);
        return enough ? magnitudes_.median() / kMedianOfNormal
                      : std::numeric_limits<double>::infinity();
    }

  private:
    std::array<double, kCount> weights_;
    double scale_ = 1;
    std::uint64_t seen_ = 0;
    Magnitudes magnitudes_;
};

class Noise {
  public:
    template <class T>
    void add(std::span<const T> row) {
        second_.add(row);
        fourth_.add(row);
        sixth_.add(row);
    }
    [[nodiscard]] double estimate() const {
        const double least = std::min({second_.noise(), fourth_.noise(), sixth_.noise()});
        return std::isfinite(least) ? least : 0;
    }

  private:
    Differences<3> second_{{1, -2, 1}};
    Differences<5> fourth_{{1, -4, 6, -4, 1}};
    Differences<7> sixth_{{1, -6, 15, -20, 15, -6, 1}};
};

/// Planes and rows that are read at a time.
std::array<std::int64_t, 2> piece_of(const VolumeSource& source, std::uint64_t memory) {
    const VolumeDescription volume = source.describe();
    const Int3& n = volume.nodes;
    const VolumeSource::Granularity order = source.granularity();
    const std::int64_t most = std::max<std::int64_t>(
        1, static_cast<std::int64_t>(memory / 4 / size_of(volume.type)) / n.x);
    const std::int64_t planes = source.sequential() ? 1 : std::min(order.planes, n.z);
    const std::int64_t rows = most / planes / order.rows * order.rows;
    return rows >= 1 ? std::array{planes, std::min(rows, n.y)}
                     : std::array{std::int64_t{1}, std::min(most, n.y)};
}

void require(bool condition, const std::string& problem) {
    if (!condition) {
        throw Error(ErrorKind::invalid_argument, problem);
    }
}

/// Of the values of an integer type: the largest minus the smallest.
double span_of(ValueType type) {
    return dispatch(type, [](auto tag) {
        using T = typename decltype(tag)::type;
        return static_cast<double>(std::numeric_limits<T>::max()) -
               static_cast<double>(std::numeric_limits<T>::lowest());
    });
}

bool is_integral(ValueType type) {
    return dispatch(type,
                    [](auto tag) { return std::is_integral_v<typename decltype(tag)::type>; });
}

DataRounding rounding_within(double value, ValueType type) {
    require(value >= 0 && std::isfinite(value),
            fmt::format("tolerance {}: must be a finite number >= 0", value));
    if (value == 0) {
        return {};
    }
    require(value < span_of(type), fmt::format("tolerance {}: must be smaller than the range of {}",
                                               value, name_of(type)));
    if (!is_integral(type)) {
        const double step = std::ldexp(1.0, std::ilogb(value) + 1);
        return {step / 2, step};
    }
    constexpr double kBytes = 32;
    const double largest = 2 * std::floor(value) + 1;
    const double power = std::ldexp(1.0, std::ilogb(largest));
    const bool is_power = size_of(type) > 1 && (power >= kBytes || 4 * power >= 3 * largest);
    const double step = is_power ? power : largest;
    return step > 1 ? DataRounding{std::floor(step / 2), step} : DataRounding{};
}

struct RoundingOf {
    ValueType type;
    const ValueSurvey& survey;

    DataRounding operator()(const WithinValue& asked) const {
        return rounding_within(asked.value, type);
    }
    DataRounding operator()(const WithinRangePart& asked) const {
        require(asked.part >= 0 && asked.part <= 1,
                fmt::format("tolerance {} of the range: give a fraction from 0 to 1", asked.part));
        return survey.min < survey.max
                   ? rounding_within(asked.part * survey.max - asked.part * survey.min, type)
                   : DataRounding{};
    }
    DataRounding operator()(const WithoutLowBits& asked) const {
        require(is_integral(type),
                fmt::format("tolerance in bits: the values are {}, not integers", name_of(type)));
        const int bits = static_cast<int>(8 * size_of(type));
        require(asked.bits >= 0 && asked.bits < bits,
                fmt::format("tolerance of {} bits: values of type {} have only {}", asked.bits,
                            name_of(type), bits));
        const double step = std::ldexp(1.0, asked.bits);
        return asked.bits == 0 ? DataRounding{} : DataRounding{step / 2, step};
    }
    DataRounding operator()(const WithinNoise& /*asked*/) const {
        return rounding_within(kPartOfNoise * survey.noise, type);
    }
};

}  // namespace

bool needs_survey(const ValueTolerance& tolerance) {
    return std::holds_alternative<WithinRangePart>(tolerance) ||
           std::holds_alternative<WithinNoise>(tolerance);
}

ValueSurvey survey_values(VolumeSource& source, const ValueTolerance& tolerance,
                          std::uint64_t memory, Progress& progress) {
    const VolumeDescription volume = source.describe();
    const Int3& n = volume.nodes;
    const std::array<std::int64_t, 2> piece = piece_of(source, memory);
    const std::int64_t planes = piece[0];
    const std::int64_t rows = piece[1];
    const bool wants_noise = std::holds_alternative<WithinNoise>(tolerance);
    ValueSurvey survey{std::numeric_limits<double>::infinity(),
                       -std::numeric_limits<double>::infinity()};
    Noise noise;
    progress.begin("survey", static_cast<std::uint64_t>(n.product()) * size_of(volume.type), "B");
    source.will_read(0, n.z, 0, n.y);
    dispatch(volume.type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::vector<T> values;
        for (std::int64_t z = 0; z < n.z; z += planes) {
            for (std::int64_t y = 0; y < n.y; y += rows) {
                progress.check();
                const std::int64_t nz = std::min(planes, n.z - z);
                const std::int64_t ny = std::min(rows, n.y - y);
                values.resize(static_cast<std::size_t>(nz * ny * n.x));
                source.read(z, nz, y, ny, reinterpret_cast<std::byte*>(values.data()));
                for (const T value : values) {
                    const auto number = static_cast<double>(value);
                    if (std::isfinite(number)) {
                        survey.min = std::min(survey.min, number);
                        survey.max = std::max(survey.max, number);
                    }
                }
                for (std::int64_t i = 0; wants_noise && i < nz * ny; ++i) {
                    noise.add(std::span<const T>(values).subspan(static_cast<std::size_t>(i * n.x),
                                                                 static_cast<std::size_t>(n.x)));
                }
                progress.advance(values.size() * sizeof(T));
            }
        }
    });
    const double found = noise.estimate();
    survey.noise = found >= kMinNoise * (survey.max - survey.min) ? found : 0;
    return survey;
}

DataRounding rounding_of(const ValueTolerance& tolerance, ValueType type,
                         const ValueSurvey& survey) {
    return std::visit(RoundingOf{type, survey}, tolerance);
}

std::string text_of(const DataRounding& rounding) {
    return rounding.none() ? ""
                           : fmt::format("values within {:.6g} (multiples of {:.6g})",
                                         rounding.tolerance, rounding.step);
}

}  // namespace isonest
