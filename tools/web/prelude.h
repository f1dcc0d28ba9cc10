// The parts of C++20 that the standard library of Debian's emscripten lacks; included before every
// source.
#pragma once

#ifdef __cplusplus
#include <strings.h>

#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <type_traits>
#include <version>

#ifndef __cpp_lib_bit_cast
namespace std {

template <class To, class From>
constexpr To bit_cast(const From& from) noexcept {
    static_assert(sizeof(To) == sizeof(From));
    static_assert(is_trivially_copyable_v<To> && is_trivially_copyable_v<From>);
    return __builtin_bit_cast(To, from);
}

}  // namespace std
#endif

#ifndef __cpp_lib_smart_ptr_for_overwrite
namespace std {

template <class T>
requires is_unbounded_array_v<T> unique_ptr<T> make_unique_for_overwrite(size_t count) {
    return unique_ptr<T>(new remove_extent_t<T>[count]);
}

}  // namespace std
#endif

#ifndef __cpp_lib_to_chars
namespace std {

/// Parses a decimal number at the start of a text. strtod() rounds as correctly, but accepts more.
inline from_chars_result from_chars(const char* first, const char* last, double& value) {
    const auto skip_digits = [last](const char* at) {
        while (at != last && *at >= '0' && *at <= '9') {
            ++at;
        }
        return at;
    };
    const char* const begin = first != last && *first == '-' ? first + 1 : first;
    const char* end = skip_digits(begin);
    auto digits = end - begin;
    if (end != last && *end == '.') {
        const char* const fraction = skip_digits(end + 1);
        digits += fraction - (end + 1);
        end = fraction;
    }
    if (digits == 0) {
        for (const char* const word : {"infinity", "inf", "nan"}) {
            const size_t size = strlen(word);
            if (static_cast<size_t>(last - begin) >= size && strncasecmp(begin, word, size) == 0) {
                value = strtod(string(first, begin + size).c_str(), nullptr);
                return {begin + size, errc()};
            }
        }
        return {first, errc::invalid_argument};
    }
    if (end != last && (*end == 'e' || *end == 'E')) {
        const char* const sign = end + 1;
        const char* const power = sign != last && (*sign == '-' || *sign == '+') ? sign + 1 : sign;
        const char* const behind = skip_digits(power);
        end = behind != power ? behind : end;
    }
    const double number = strtod(string(first, end).c_str(), nullptr);
    const bool is_small = number == 0 && string(begin, end).find_first_of("123456789") <
                                             string(begin, end).find_first_of("eE");
    if (is_small || number - number != 0) {
        return {end, errc::result_out_of_range};
    }
    value = number;
    return {end, errc()};
}

}  // namespace std
#endif
#endif
