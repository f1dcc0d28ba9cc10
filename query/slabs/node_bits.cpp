#include "query/slabs/node_bits.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include <isonest/value_type.h>

#include "store/base/simd.h"

namespace isonest::detail {
namespace {

constexpr std::uint8_t kBelowBit = 1;
constexpr std::uint8_t kSpecialBit = 2;

template <class T>
ISONEST_SIMD void mark_sides(const T* value, T limit, std::uint8_t* __restrict out,
                             std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = value[i] < limit ? kBelowBit : 0;
    }
}

template <class T>
ISONEST_SIMD void mark_special(const T* value, T limit, T hit, std::uint8_t* __restrict out,
                               std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        const T v = value[i];
        bool special = v == hit;
        if constexpr (std::is_floating_point_v<T>) {
            special = special | !(std::fabs(v) <= std::numeric_limits<T>::max());
        }
        out[i] =
            static_cast<std::uint8_t>((v < limit ? kBelowBit : 0) | (special ? kSpecialBit : 0));
    }
}

/// Bit `bit` of eight bytes, side by side.
std::uint64_t packed(std::uint64_t bytes, unsigned bit) {
    static_assert(std::endian::native == std::endian::little);
    constexpr std::uint64_t kLowest = 0x0101010101010101U;
    constexpr std::uint64_t kToTop = 0x0102040810204080U;  // the lowest bit of byte i to 56 + i
    return ((bytes >> bit & kLowest) * kToTop) >> 56U;
}

/// Of `n` values beside each other into that many ranges.
template <class T>
ISONEST_SIMD void widen_ranges(const T* value, std::int64_t n, T* __restrict low,
                               T* __restrict high) {
    for (std::int64_t i = 0; i < n; ++i) {
        const T v = value[i];
        bool finite = true;
        if constexpr (std::is_floating_point_v<T>) {
            finite = std::fabs(v) <= std::numeric_limits<T>::max();
        }
        low[i] = finite && v < low[i] ? v : low[i];
        high[i] = finite && v > high[i] ? v : high[i];
    }
}

}  // namespace

template <class T>
bool NodeBits<T>::crosses(double iso) {
    return iso > static_cast<double>(std::numeric_limits<T>::lowest()) &&
           iso <= static_cast<double>(std::numeric_limits<T>::max());
}

template <class T>
NodeBits<T>::NodeBits(double iso) {
    if constexpr (std::is_integral_v<T>) {
        limit_ = static_cast<T>(std::ceil(iso));
        hit_ = limit_;
        special_ = static_cast<double>(limit_) == iso;
    } else {
        const auto near = static_cast<T>(iso);
        limit_ = static_cast<double>(near) < iso
                     ? std::nextafter(near, std::numeric_limits<T>::infinity())
                     : near;
        hit_ = static_cast<double>(limit_) == iso ? limit_ : std::numeric_limits<T>::quiet_NaN();
        special_ = true;
    }
}

template <class T>
bool NodeBits<T>::of_row(const T* row, std::int64_t nodes, std::uint64_t* below,
                         std::uint64_t* special) const {
    constexpr std::int64_t kWordsAtOnce = 8;
    std::array<std::uint8_t, 64 * kWordsAtOnce> marks{};
    std::uint64_t any = 0;
    for (std::int64_t at = 0; at < nodes; at += 64 * kWordsAtOnce) {
        const std::int64_t count = std::min(nodes - at, 64 * kWordsAtOnce);
        if (special_) {
            mark_special(row + at, limit_, hit_, marks.data(), count);
        } else {
            mark_sides(row + at, limit_, marks.data(), count);
        }
        const std::int64_t words = (count + 63) / 64;
        std::fill(marks.begin() + count, marks.begin() + 64 * words, std::uint8_t{0});
        for (std::int64_t w = 0; w < words; ++w) {
            std::uint64_t below_word = 0;
            std::uint64_t special_word = 0;
            for (unsigned byte = 0; byte < 8; ++byte) {
                std::uint64_t eight = 0;
                std::memcpy(&eight, marks.data() + 64 * w + 8 * byte, sizeof(eight));
                below_word |= packed(eight, 0) << (8 * byte);
                special_word |= packed(eight, 1) << (8 * byte);
            }
            below[at / 64 + w] = below_word;
            special[at / 64 + w] = special_word;
            any |= special_word;
        }
    }
    return any != 0;
}

template <class T>
void widen_range(const T* values, std::int64_t count, double& low, double& high) {
    constexpr std::int64_t kAtOnce = 256;
    std::array<T, kAtOnce> least;
    std::array<T, kAtOnce> most;
    least.fill(std::numeric_limits<T>::max());
    most.fill(std::numeric_limits<T>::lowest());
    for (std::int64_t at = 0; at < count; at += kAtOnce) {
        widen_ranges(values + at, std::min(count - at, kAtOnce), least.data(), most.data());
    }
    const T smallest = *std::min_element(least.begin(), least.end());
    const T largest = *std::max_element(most.begin(), most.end());
    if (smallest <= largest) {
        low = std::min(low, static_cast<double>(smallest));
        high = std::max(high, static_cast<double>(largest));
    }
}

#define ISONEST_INSTANTIATE(tag, T) \
    template class NodeBits<T>;     \
    template void widen_range<T>(const T*, std::int64_t, double&, double&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE

}  // namespace isonest::detail
