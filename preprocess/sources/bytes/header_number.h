// Numbers in binary headers.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstring>
#include <string_view>

namespace isonest::detail {

/// The number of type T at byte `at`. REQUIRES: it lies within `head`.
template <class T>
T number_at(std::string_view head, std::size_t at, bool big_endian) {
    std::array<char, sizeof(T)> bytes{};
    std::copy_n(head.begin() + static_cast<std::ptrdiff_t>(at), sizeof(T), bytes.begin());
    if (big_endian) {
        std::reverse(bytes.begin(), bytes.end());
    }
    return std::bit_cast<T>(bytes);
}

}  // namespace isonest::detail
