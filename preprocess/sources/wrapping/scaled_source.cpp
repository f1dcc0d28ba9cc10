#include "preprocess/sources/wrapping/scaled_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
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

/// float32 numbers are what they are compared with, rounded: 1e20 as float64 is no float32.
Scaling as_stored(ValueType stored, const Scaling& scaling) {
    Scaling rounded = scaling;
    if (stored == ValueType::f32) {
        const auto round = [](double& number) {
            // 3.40282347e+38, as the largest float32 is often written, is above it.
            constexpr double kMost = std::numeric_limits<float>::max();
            constexpr double kInfinite = 0x1.ffffffp127;
            const double size = std::fabs(number);
            number = size >= kInfinite ? std::copysign(HUGE_VAL, number)
                     : size > kMost    ? std::copysign(kMost, number)
                                       : static_cast<double>(static_cast<float>(number));
        };
        std::for_each(rounded.missing.begin(), rounded.missing.end(), round);
        round(rounded.least_valid);
        round(rounded.most_valid);
    }
    return rounded;
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
            fmt::join(scaling_.missing, " "), scaling_.least_valid, scaling_.most_valid));
    }
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> notes = inner_source().notes();
        notes.push_back(text_of(scaling_));
        return notes;
    }
    /// The stored numbers are read into the end of `dst` and scaled from its start on.
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const auto count = static_cast<std::size_t>(nz * ny * given_.nodes.x);
        std::byte* const from = dst + count * (size_of(made_) - size_of(given_.type));
        inner_source().read(z0, nz, y0, ny, from);
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
               !(v >= compared_.least_valid && v <= compared_.most_valid);
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
                        fmt::format("there is a stored number {}, but its header says that they "
                                    "are {} to {}",
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
    Scaling compared_;  ///< with what is missing and valid as stored numbers
};

}  // namespace

ValueType scaled_type(ValueType stored, const Scaling& scaling) {
    const std::size_t width = size_of(stored);
    const bool integer =
        dispatch(stored, [](auto tag) { return std::is_integral_v<typename decltype(tag)::type>; });
    Scaling linear = scaling;
    linear.stored.reset();
    const bool all_valid =
        linear.missing.empty() && linear.least_valid == -HUGE_VAL && linear.most_valid == HUGE_VAL;
    if (integer && all_valid && is_whole(scaling.slope) && is_whole(scaling.intercept)) {
        const Range range = scaled_range(stored, scaling);
        constexpr std::array kIntegers{ValueType::u8,  ValueType::i8,  ValueType::u16,
                                       ValueType::i16, ValueType::u32, ValueType::i32};
        // The stored type first, if it serves.
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
                    fmt::format("values that are {} times the stored number plus {}", scaling.slope,
                                scaling.intercept));
    }
    if (scaling.changes_nothing()) {
        return inner;
    }
    return std::make_unique<ScaledSource>(std::move(inner), scaling);
}

std::string text_of(const Scaling& scaling) {
    std::string text;
    if (scaling.slope != 1 || scaling.intercept != 0) {
        text = fmt::format("values are {} times what is stored, plus {}", scaling.slope,
                           scaling.intercept);
    }
    if (!scaling.missing.empty()) {
        text += fmt::format("{}stored {} means missing", text.empty() ? "" : "; ",
                            fmt::join(scaling.missing, " and "));
    }
    if (scaling.least_valid > -HUGE_VAL || scaling.most_valid < HUGE_VAL) {
        text += fmt::format("{}stored numbers outside of {} to {} are missing",
                            text.empty() ? "" : "; ", scaling.least_valid, scaling.most_valid);
    }
    return text;
}

}  // namespace isonest::detail
