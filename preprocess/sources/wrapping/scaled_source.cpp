#include "preprocess/sources/wrapping/scaled_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/base/label_text.h"

namespace isonest::detail {
namespace {

/// Source: IEEE 754, binary16.
float from_half(std::uint16_t bits) {
    constexpr unsigned kMantissaBits = 10;
    const unsigned exponent = (bits >> kMantissaBits) & 0x1FU;
    const auto mantissa = static_cast<float>(bits & 0x3FFU);
    const float sign = (bits & 0x8000U) != 0 ? -1.0F : 1.0F;
    if (exponent == 0x1FU) {
        return mantissa == 0 ? sign * HUGE_VALF : NAN;
    }
    constexpr float kSteps = 1024;
    constexpr int kBias = 15;
    return exponent == 0
               ? sign * std::ldexp(mantissa / kSteps, 1 - kBias)
               : sign * std::ldexp(1 + mantissa / kSteps, static_cast<int>(exponent) - kBias);
}

class ConvertedSource : public WrappedSource {
  public:
    ConvertedSource(std::unique_ptr<VolumeSource> inner, StoredNumber stored)
        : WrappedSource(std::move(inner)), given_(inner_source().describe()), stored_(stored) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = given_;
        result.type = stored_ == StoredNumber::f16 ? ValueType::f32 : ValueType::f64;
        result.labels = labels_;
        return result;
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(
            fmt::format("numbers {}{}", static_cast<int>(stored_), labels_ ? " labels" : ""));
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(nz * ny * given_.nodes.x);
        if (stored_ == StoredNumber::f16) {
            std::byte* const from = dst + count * sizeof(std::uint16_t);
            inner_source().read(z0, nz, y0, ny, from);
            for (std::size_t i = 0; i < count; ++i) {
                std::uint16_t bits = 0;
                std::memcpy(&bits, from + i * sizeof(bits), sizeof(bits));
                const float value = from_half(bits);
                std::memcpy(dst + i * sizeof(value), &value, sizeof(value));
            }
            return;
        }
        inner_source().read(z0, nz, y0, ny, dst);
        if (labels_) {
            to_labels(given_.name, count, dst);
        } else if (stored_ == StoredNumber::i64) {
            to_double<std::int64_t>(count, dst);
        } else {
            to_double<std::uint64_t>(count, dst);
        }
    }

    void take_for_labels() { labels_ = stored_ != StoredNumber::f16; }

  private:
    template <class T>
    void to_double(std::size_t count, std::byte* values) const {
        for (std::size_t i = 0; i < count; ++i) {
            T in{};
            std::memcpy(&in, values + i * sizeof(in), sizeof(in));
            constexpr T kMax = T{1} << 53U;
            bool exact = in <= kMax;
            if constexpr (std::is_signed_v<T>) {
                exact = exact && in >= -kMax;
            }
            if (!exact) {
                throw Error(ErrorKind::unsupported, {given_.name},
                            "there are 64-bit integers that float64 cannot hold (beyond 2^53)");
            }
            const auto out = static_cast<double>(in);
            std::memcpy(values + i * sizeof(out), &out, sizeof(out));
        }
    }

    VolumeDescription given_;
    StoredNumber stored_;
    bool labels_ = false;
};

}  // namespace

void to_labels(const std::string& name, std::size_t count, std::byte* values) {
    for (std::size_t i = 0; i < count; ++i) {
        std::uint64_t label = 0;
        std::memcpy(&label, values + i * sizeof(label), sizeof(label));
        if (label > kMaxLabel) {
            throw Error(
                ErrorKind::unsupported, {name},
                fmt::format("the value {} is not a label: labels are 0 to 2^62 - 1", label));
        }
        const double value = value_of_label(label);
        std::memcpy(values + i * sizeof(value), &value, sizeof(value));
    }
}

void take_for_labels(VolumeSource& source) {
    if (const auto* const outer = dynamic_cast<DescribedSource*>(&source)) {
        take_for_labels(outer->undescribed());
    } else if (auto* const numbers = dynamic_cast<ConvertedSource*>(&source)) {
        numbers->take_for_labels();
    }
}

std::uint16_t half_of(double value) {
    constexpr std::uint32_t kNan = 0x7E00;
    constexpr std::uint32_t kInfinity = 0x7C00;
    constexpr std::uint32_t kNegative = 0x8000;
    constexpr double kTooLarge = 65520;
    constexpr int kMantissaBits = 10;
    constexpr int kBias = 15;
    if (std::isnan(value)) {
        return kNan;
    }
    const double size = std::fabs(value);
    std::uint32_t bits = 0;
    if (size >= kTooLarge) {
        bits = kInfinity;
    } else if (size > 0) {
        const int exponent = std::max(std::ilogb(size), 1 - kBias);
        const double mantissa = std::nearbyint(std::ldexp(size, kMantissaBits - exponent));
        const auto above = static_cast<std::uint32_t>(exponent + kBias - 1) << kMantissaBits;
        // The mantissa's leading one increments the exponent; a subnormal number has none.
        bits = above + static_cast<std::uint32_t>(mantissa);
    }
    return static_cast<std::uint16_t>(bits | (std::signbit(value) ? kNegative : 0));
}

ValueType bits_type(StoredNumber stored) {
    return stored == StoredNumber::f16 ? ValueType::u16 : ValueType::f64;
}

std::unique_ptr<VolumeSource> converted(std::unique_ptr<VolumeSource> inner, StoredNumber stored) {
    return std::make_unique<ConvertedSource>(std::move(inner), stored);
}

namespace {

class MissingSource : public WrappedSource {
  public:
    MissingSource(std::unique_ptr<VolumeSource> inner, double missing)
        : WrappedSource(std::move(inner)), given_(inner_source().describe()), missing_(missing) {
        const ValueType type = given_.type;
        single_ = size_of(type) <= 2 || type == ValueType::f32;
        const bool holds = dispatch(type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            if constexpr (std::is_floating_point_v<T>) {
                return true;
            } else {
                return missing >= static_cast<double>(std::numeric_limits<T>::min()) &&
                       missing <= static_cast<double>(std::numeric_limits<T>::max()) &&
                       missing == std::floor(missing);
            }
        });
        if (!holds) {
            throw Error(ErrorKind::invalid_argument, {given_.name},
                        fmt::format("no value of type {} equals the missing value {}",
                                    name_of(type), missing),
                        {{RemedyKind::leave_out, "missing"}});
        }
    }
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = given_;
        result.type = made();
        return result;
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(fmt::format("missing {}", missing_));
    }
    /// Reads the inner values into the end of `dst` and widens them in place from its start.
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(nz * ny * given_.nodes.x);
        const std::size_t narrow = size_of(given_.type);
        std::byte* const from = dst + count * (size_of(made()) - narrow);
        inner_source().read(z0, nz, y0, ny, from);
        dispatch(given_.type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            if (single_) {
                widen<T, float>(from, count, dst);
            } else {
                widen<T, double>(from, count, dst);
            }
        });
    }

  private:
    [[nodiscard]] ValueType made() const { return single_ ? ValueType::f32 : ValueType::f64; }

    template <class T, class To>
    void widen(const std::byte* from, std::size_t count, std::byte* to) const {
        const T missing = static_cast<T>(missing_);
        for (std::size_t i = 0; i < count; ++i) {
            T in{};
            std::memcpy(&in, from + i * sizeof(T), sizeof(T));
            const To out =
                in == missing ? std::numeric_limits<To>::quiet_NaN() : static_cast<To>(in);
            std::memcpy(to + i * sizeof(To), &out, sizeof(To));
        }
    }

    VolumeDescription given_;
    double missing_;
    bool single_ = true;
};

}  // namespace

std::unique_ptr<VolumeSource> with_missing(std::unique_ptr<VolumeSource> inner, double missing) {
    return std::make_unique<MissingSource>(std::move(inner), missing);
}

namespace {

struct Range {
    double low;
    double high;
};

template <class T>
bool holds(const Range& range) {
    return range.low >= static_cast<double>(std::numeric_limits<T>::min()) &&
           range.high <= static_cast<double>(std::numeric_limits<T>::max());
}

bool is_whole(double value) {
    return value == std::floor(value) && std::fabs(value) < 9e15;
}

Range scaled_range(ValueType stored, const Scaling& s) {
    const Range whole = dispatch(stored, [](auto tag) {
        using T = typename decltype(tag)::type;
        return Range{static_cast<double>(std::numeric_limits<T>::lowest()),
                     static_cast<double>(std::numeric_limits<T>::max())};
    });
    const Range range = s.stored ? Range{static_cast<double>(s.stored->first),
                                         static_cast<double>(s.stored->second)}
                                 : whole;
    const double a = s.slope * range.low + s.intercept;
    const double b = s.slope * range.high + s.intercept;
    return {std::min(a, b), std::max(a, b)};
}

/// Rounds to float32 what is compared with float32 numbers: 1e20 as float64 is not a float32.
Scaling as_stored(ValueType stored, const Scaling& scaling) {
    Scaling rounded = scaling;
    if (stored == ValueType::f32) {
        const auto round = [](double& number) {
            // 3.40282347e+38, a common spelling of the largest float32, is larger than it.
            constexpr double kMax = std::numeric_limits<float>::max();
            constexpr double kInfinite = 0x1.ffffffp127;
            const double size = std::fabs(number);
            number = size >= kInfinite ? std::copysign(HUGE_VAL, number)
                     : size > kMax     ? std::copysign(kMax, number)
                                       : static_cast<double>(static_cast<float>(number));
        };
        std::for_each(rounded.missing.begin(), rounded.missing.end(), round);
        round(rounded.min_valid);
        round(rounded.max_valid);
    }
    return rounded;
}

/// Rows of a volume: planes z0 to z0 + nz, and of each the rows y0 to y0 + ny.
struct Rows {
    std::int64_t z0;
    std::int64_t nz;
    std::int64_t y0;
    std::int64_t ny;
};

/// Reads stored numbers into the end of `dst`, which has room for as many of type `made`. They can
/// be converted in place from the start of `dst`. Returns where they begin.
const std::byte* read_at_end(VolumeSource& source, const VolumeDescription& given, ValueType made,
                             const Rows& rows, std::byte* dst) {
    const auto count = static_cast<std::size_t>(rows.nz * rows.ny * given.nodes.x);
    std::byte* const from = dst + count * (size_of(made) - size_of(given.type));
    source.read(rows.z0, rows.nz, rows.y0, rows.ny, from);
    return from;
}

class ScaledSource : public WrappedSource {
  public:
    ScaledSource(std::unique_ptr<VolumeSource> inner, Scaling scaling)
        : WrappedSource(std::move(inner)),
          given_(inner_source().describe()),
          made_(scaled_type(given_.type, scaling)),
          scaling_(std::move(scaling)),
          compared_(as_stored(given_.type, scaling_)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = given_;
        result.type = made_;
        return result;
    }
    [[nodiscard]] std::string identity() const override {
        return identity_and(fmt::format(
            "slope {} intercept {} missing {} valid {} {}", scaling_.slope, scaling_.intercept,
            fmt::join(scaling_.missing, " "), scaling_.min_valid, scaling_.max_valid));
    }
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> notes = inner_source().notes();
        notes.push_back(text_of(scaling_));
        return notes;
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(nz * ny * given_.nodes.x);
        const std::byte* const from =
            read_at_end(inner_source(), given_, made_, {z0, nz, y0, ny}, dst);
        dispatch(given_.type, [&](auto stored) {
            dispatch(made_, [&](auto made) {
                using From = typename decltype(stored)::type;
                using To = typename decltype(made)::type;
                if constexpr (sizeof(To) >= sizeof(From)) {
                    scale<From, To>(from, count, dst);
                }
            });
        });
    }

  private:
    template <class T>
    [[nodiscard]] bool is_missing(T value) const {
        const auto v = static_cast<double>(value);
        return std::find(compared_.missing.begin(), compared_.missing.end(), v) !=
                   compared_.missing.end() ||
               !(v >= compared_.min_valid && v <= compared_.max_valid);
    }
    template <class From, class To>
    void scale(const std::byte* from, std::size_t count, std::byte* to) const {
        for (std::size_t i = 0; i < count; ++i) {
            From in{};
            std::memcpy(&in, from + i * sizeof(From), sizeof(From));
            To out{};
            const double value = scaling_.slope * static_cast<double>(in) + scaling_.intercept;
            if constexpr (std::is_floating_point_v<To>) {
                out =
                    is_missing(in) ? std::numeric_limits<To>::quiet_NaN() : static_cast<To>(value);
            } else {
                if (!holds<To>({value, value})) {
                    throw Error(
                        ErrorKind::corrupt, {given_.name},
                        fmt::format(
                            "there is a stored number {}, but the header gives the range {} to {}",
                            in, scaling_.stored->first, scaling_.stored->second));
                }
                out = static_cast<To>(value);
            }
            std::memcpy(to + i * sizeof(To), &out, sizeof(To));
        }
    }

    VolumeDescription given_;
    ValueType made_;
    Scaling scaling_;
    Scaling compared_;  ///< with the missing and valid values in stored numbers
};

}  // namespace

ValueType scaled_type(ValueType stored, const Scaling& scaling) {
    const std::size_t width = size_of(stored);
    const bool integer =
        dispatch(stored, [](auto tag) { return std::is_integral_v<typename decltype(tag)::type>; });
    Scaling linear = scaling;
    linear.stored.reset();
    const bool all_valid =
        linear.missing.empty() && linear.min_valid == -HUGE_VAL && linear.max_valid == HUGE_VAL;
    if (integer && all_valid && is_whole(scaling.slope) && is_whole(scaling.intercept)) {
        const Range range = scaled_range(stored, scaling);
        constexpr std::array kIntegers{ValueType::u8,  ValueType::i8,  ValueType::u16,
                                       ValueType::i16, ValueType::u32, ValueType::i32};
        // The stored type first, if it is sufficient.
        std::vector<ValueType> candidates{stored};
        candidates.insert(candidates.end(), kIntegers.begin(), kIntegers.end());
        for (const ValueType type : candidates) {
            const bool fits = dispatch(type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                if constexpr (std::is_integral_v<T>) {
                    return sizeof(T) >= width && holds<T>(range);
                } else {
                    return false;
                }
            });
            if (fits) {
                return type;
            }
        }
    }
    return width <= 2 || stored == ValueType::f32 ? ValueType::f32 : ValueType::f64;
}

std::unique_ptr<VolumeSource> scaled(std::unique_ptr<VolumeSource> inner, const Scaling& scaling) {
    if (!std::isfinite(scaling.slope) || !std::isfinite(scaling.intercept) || scaling.slope == 0) {
        throw Error(ErrorKind::corrupt, {inner->describe().name},
                    fmt::format("invalid scaling: {} times the stored number plus {}",
                                scaling.slope, scaling.intercept));
    }
    if (scaling.changes_nothing()) {
        return inner;
    }
    return std::make_unique<ScaledSource>(std::move(inner), scaling);
}

std::string text_of(const Scaling& scaling) {
    std::string text;
    if (scaling.slope != 1 || scaling.intercept != 0) {
        text = fmt::format("values are {} times the stored number plus {}", scaling.slope,
                           scaling.intercept);
    }
    if (!scaling.missing.empty()) {
        text += fmt::format("{}stored {} means missing", text.empty() ? "" : "; ",
                            fmt::join(scaling.missing, " and "));
    }
    if (scaling.min_valid > -HUGE_VAL || scaling.max_valid < HUGE_VAL) {
        text += fmt::format("{}stored numbers outside {} to {} are missing",
                            text.empty() ? "" : "; ", scaling.min_valid, scaling.max_valid);
    }
    return text;
}

namespace {

bool keeps_all(const SliceScaling& scaling) {
    return std::all_of(scaling.lines.begin(), scaling.lines.end(),
                       [](const SliceScaling::Line& line) { return line == SliceScaling::Line{}; });
}

class SliceScaledSource : public WrappedSource {
  public:
    SliceScaledSource(std::unique_ptr<VolumeSource> inner, SliceScaling scaling)
        : WrappedSource(std::move(inner)),
          given_(inner_source().describe()),
          made_(keeps_all(scaling)                                           ? given_.type
                : size_of(given_.type) <= 2 || given_.type == ValueType::f32 ? ValueType::f32
                                                                             : ValueType::f64),
          scaling_(std::move(scaling)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = given_;
        result.type = made_;
        return result;
    }
    [[nodiscard]] std::string identity() const override {
        // FNV-1a of all lines.
        std::uint64_t digest = 0xcbf29ce484222325;
        for (const SliceScaling::Line& line : scaling_.lines) {
            for (const double number : {line.slope, line.intercept}) {
                std::uint64_t bits = 0;
                std::memcpy(&bits, &number, sizeof(bits));
                digest = (digest ^ bits) * 0x100000001b3;
            }
        }
        return identity_and(fmt::format("slices scaled {:x}, from {} to {}", digest, scaling_.least,
                                        scaling_.most));
    }
    [[nodiscard]] std::uint64_t heap() const override {
        return inner_source().heap() + scaling_.lines.size() * sizeof(SliceScaling::Line);
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const std::byte* const from =
            read_at_end(inner_source(), given_, made_, {z0, nz, y0, ny}, dst);
        dispatch(given_.type, [&](auto stored) {
            dispatch(made_, [&](auto made) {
                using From = typename decltype(stored)::type;
                using To = typename decltype(made)::type;
                if constexpr (sizeof(To) >= sizeof(From) &&
                              (std::is_floating_point_v<To> || std::is_same_v<From, To>)) {
                    const auto row = static_cast<std::size_t>(given_.nodes.x);
                    for (std::int64_t i = 0; i < nz * ny; ++i) {
                        const auto at = static_cast<std::size_t>(i) * row;
                        scale_row<From, To>(z0 + i / ny, y0 + i % ny, from + at * sizeof(From),
                                            dst + at * sizeof(To));
                    }
                }
            });
        });
    }

  private:
    template <class From, class To>
    void scale_row(std::int64_t z, std::int64_t y, const std::byte* from, std::byte* to) const {
        const Int3& s = scaling_.strides;
        for (std::int64_t x = 0; x < given_.nodes.x; ++x) {
            From in{};
            std::memcpy(&in, from + static_cast<std::size_t>(x) * sizeof(From), sizeof(From));
            const auto line = static_cast<std::size_t>(x * s.x + y * s.y + z * s.z);
            const auto [slope, intercept] = scaling_.lines[line];
            const double value =
                slope * std::clamp(static_cast<double>(in), scaling_.least, scaling_.most) +
                intercept;
            const To out = static_cast<To>(value);
            std::memcpy(to + static_cast<std::size_t>(x) * sizeof(To), &out, sizeof(To));
        }
    }

    VolumeDescription given_;
    ValueType made_;
    SliceScaling scaling_;
};

}  // namespace

std::unique_ptr<VolumeSource> scaled_by_slices(std::unique_ptr<VolumeSource> inner,
                                               SliceScaling scaling) {
    const bool all_valid = dispatch(inner->describe().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        return scaling.least <= static_cast<double>(std::numeric_limits<T>::lowest()) &&
               scaling.most >= static_cast<double>(std::numeric_limits<T>::max());
    });
    if (keeps_all(scaling) && all_valid) {
        return inner;
    }
    return std::make_unique<SliceScaledSource>(std::move(inner), std::move(scaling));
}

}  // namespace isonest::detail
