// The eight scalar types of a volume, and conversion between the run-time tag and the C++ type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

// NOLINTBEGIN(bugprone-macro-parentheses): the arguments are names and types

/// The list of all types: X(tag, type) for each.
#define ISONEST_FOR_EACH_VALUE_TYPE(X) \
    X(u8, std::uint8_t)                \
    X(i8, std::int8_t)                 \
    X(u16, std::uint16_t)              \
    X(i16, std::int16_t)               \
    X(u32, std::uint32_t)              \
    X(i32, std::int32_t)               \
    X(f32, float)                      \
    X(f64, double)

namespace isonest {

#define ISONEST_TAG(tag, T) tag,
/// u8, i8, u16, i16, u32, i32, f32, f64.
enum class ValueType : std::uint8_t { ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_TAG) };
#undef ISONEST_TAG

template <class T>
struct TypeTag {
    using type = T;
};

/// Calls f(TypeTag<T>{}) with the C++ type T of `type`.
template <class F>
decltype(auto) dispatch(ValueType type, F&& f) {
    switch (type) {
#define ISONEST_CASE(tag, T) \
    case ValueType::tag:     \
        return std::forward<F>(f)(TypeTag<T>{});
        ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_CASE)
#undef ISONEST_CASE
    }
    return std::forward<F>(f)(TypeTag<double>{});
}

/// The tag of a C++ type; defined only for the eight types.
template <class T>
inline constexpr ValueType value_type_of = [] {
#define ISONEST_IS(tag, Type)                \
    if constexpr (std::is_same_v<T, Type>) { \
        return ValueType::tag;               \
    } else
    ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_IS) {
        static_assert(!sizeof(T), "volumes are of integers of 8, 16 or 32 bits, float or double");
    }
#undef ISONEST_IS
}();

// NOLINTEND(bugprone-macro-parentheses)

/// Bytes of one value.
std::size_t size_of(ValueType type);
/// "uint8", "int8", "uint16", "int16", "uint32", "int32", "float32" or "float64".
std::string_view name_of(ValueType type);
/// Inverse of name_of(); also takes the short forms "u8", "i16", "f32", "float", "double", ...
std::optional<ValueType> value_type_from_name(std::string_view name);

/// The type in which indicators of values of type T are computed: float if it is exact for sums of
/// two values times dyadic weights, else double.
template <class T>
using RealFor = std::conditional_t<sizeof(T) <= 2, float, double>;

/// Whether that arithmetic rounds, so that indicators have to be rounded outward
/// (store/base/vectors.h).
template <class T>
inline constexpr bool rounds_outward = std::is_same_v<T, double>;

}  // namespace isonest
