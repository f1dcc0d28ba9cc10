#include "preprocess/sources/wrapping/slice_scaled_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
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
