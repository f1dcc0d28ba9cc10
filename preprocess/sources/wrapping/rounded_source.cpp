#include "preprocess/sources/wrapping/rounded_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
namespace {

/// Halves are rounded away from 0, so that the result does not depend on the rounding mode.
template <class T>
T rounded_integer(T value, std::int64_t step) {
    const std::int64_t v = value;
    const std::int64_t half = step / 2;
    const std::int64_t multiple = (v >= 0 ? v + half : v - half) / step * step;
    return static_cast<T>(std::clamp<std::int64_t>(multiple, std::numeric_limits<T>::min(),
                                                   std::numeric_limits<T>::max()));
}

/// REQUIRES: step is a power of two.
template <class T>
T rounded_number(T value, double step) {
    // From here on every number of the type is a multiple of the step. Not true for NaN.
    const double all = std::ldexp(step, std::numeric_limits<T>::digits - 1);
    if (!(std::fabs(static_cast<double>(value)) < all)) {
        return value;
    }
    // All operations are exact but round(). + 0: no negative zeros.
    const double rounded = std::round(static_cast<double>(value) / step) * step + 0.0;
    return std::fabs(rounded) <= static_cast<double>(std::numeric_limits<T>::max())
               ? static_cast<T>(rounded)
               : value;
}

class RoundedSource : public WrappedSource {
  public:
    RoundedSource(VolumeSource& inner, const DataRounding& rounding)
        : WrappedSource(inner), rounding_(rounding), given_(inner.describe()) {
        if (const std::size_t size = size_of(given_.type); size <= 2) {
            for (std::uint32_t bits = 0; bits < 1U << (8 * size); ++bits) {
                table_.push_back(static_cast<std::uint16_t>(bits));
                round_values(given_.type, rounding_, 1,
                             reinterpret_cast<std::byte*>(&table_.back()));
            }
        }
    }

    [[nodiscard]] std::string identity() const override {
        return identity_and(fmt::format("rounded to multiples of {}", rounding_.step));
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        inner_source().read(z0, nz, y0, ny, dst);
        const auto count = static_cast<std::size_t>(nz * ny * given_.nodes.x);
        if (size_of(given_.type) == 1) {
            look_up<std::uint8_t>(count, dst);
        } else if (size_of(given_.type) == 2) {
            look_up<std::uint16_t>(count, dst);
        } else {
            round_values(given_.type, rounding_, count, dst);
        }
    }

  private:
    template <class Bits>
    void look_up(std::size_t count, std::byte* values) const {
        for (std::size_t i = 0; i < count; ++i) {
            Bits bits;
            std::memcpy(&bits, values + i * sizeof(bits), sizeof(bits));
            bits = static_cast<Bits>(table_[bits]);
            std::memcpy(values + i * sizeof(bits), &bits, sizeof(bits));
        }
    }

    DataRounding rounding_;
    VolumeDescription given_;
    std::vector<std::uint16_t> table_;  ///< of values of one or two bytes, by their bits
};

}  // namespace

void round_values(ValueType type, const DataRounding& rounding, std::size_t count,
                  std::byte* values) {
    dispatch(type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        for (std::size_t i = 0; i < count; ++i) {
            T value;
            std::memcpy(&value, values + i * sizeof(T), sizeof(T));
            if constexpr (std::is_integral_v<T>) {
                value = rounded_integer(value, static_cast<std::int64_t>(rounding.step));
            } else {
                value = rounded_number(value, rounding.step);
            }
            std::memcpy(values + i * sizeof(T), &value, sizeof(T));
        }
    });
}

std::unique_ptr<VolumeSource> rounded_source(VolumeSource& inner, const DataRounding& rounding) {
    return rounding.none() ? nullptr : std::make_unique<RoundedSource>(inner, rounding);
}

}  // namespace isonest::detail
