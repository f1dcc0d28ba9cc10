#include "preprocess/sources/wrapping/missing_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/wrapped_source.h"

namespace isonest::detail {
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
                        fmt::format("no value of type {} is {}, which is to mean missing data",
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
    /// The inner values are read into the end of `dst` and widened from its start on.
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

}  // namespace isonest::detail
