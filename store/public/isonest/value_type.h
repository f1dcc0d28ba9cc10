// The eight scalar types of a volume, and a dispatch from the run-time tag to the C++ type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

namespace isonest {

enum class ValueType : std::uint8_t { u8, i8, u16, i16, u32, i32, f32, f64 };

template <class T>
struct TypeTag {
    using type = T;
};

/// Calls f(TypeTag<T>{}) with the C++ type that `type` names.
template <class F>
decltype(auto) dispatch(ValueType type, F&& f) {
    switch (type) {
        case ValueType::u8:
            return std::forward<F>(f)(TypeTag<std::uint8_t>{});
        case ValueType::i8:
            return std::forward<F>(f)(TypeTag<std::int8_t>{});
        case ValueType::u16:
            return std::forward<F>(f)(TypeTag<std::uint16_t>{});
        case ValueType::i16:
            return std::forward<F>(f)(TypeTag<std::int16_t>{});
        case ValueType::u32:
            return std::forward<F>(f)(TypeTag<std::uint32_t>{});
        case ValueType::i32:
            return std::forward<F>(f)(TypeTag<std::int32_t>{});
        case ValueType::f32:
            return std::forward<F>(f)(TypeTag<float>{});
        case ValueType::f64:
            break;
    }
    return std::forward<F>(f)(TypeTag<double>{});
}

/// Bytes of one value.
std::size_t size_of(ValueType type);
/// "uint8", "int8", "uint16", "int16", "uint32", "int32", "float32" or "float64".
std::string_view name_of(ValueType type);
/// Inverse of name_of(); also takes the short forms "u8", "i16", "f32", "float", "double", ...
std::optional<ValueType> value_type_from_name(std::string_view name);

/// The arithmetic in which indicators of values of type T are computed: float where it is exact for
/// sums of two values times dyadic weights, else double.
template <class T>
using RealFor = std::conditional_t<sizeof(T) <= 2, float, double>;

/// Whether that arithmetic rounds, and indicators have to be rounded outward
/// (store/base/outward.h).
template <class T>
inline constexpr bool rounds_outward = std::is_same_v<T, double>;

}  // namespace isonest
