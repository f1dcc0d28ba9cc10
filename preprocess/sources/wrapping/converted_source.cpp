#include "preprocess/sources/wrapping/converted_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/described_source.h"
#include "store/base/label_bits.h"

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
            constexpr T kMost = T{1} << 53U;
            bool exact = in <= kMost;
            if constexpr (std::is_signed_v<T>) {
                exact = exact && in >= -kMost;
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
        if (label > kMostLabel) {
            throw Error(ErrorKind::unsupported, {name},
                        fmt::format("{} is no label: they are 0 to 2^62 - 1", label));
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
        // The mantissa's leading one counts in the exponent; a subnormal number has none.
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

}  // namespace isonest::detail
