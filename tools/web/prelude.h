// What C++20 has and the standard library of Debian's emscripten has not; included before every
// source.
#pragma once

#ifdef __cplusplus
#include <cstddef>
#include <cstring>
#include <memory>
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
#endif
