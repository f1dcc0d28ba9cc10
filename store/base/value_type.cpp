#include <array>

#include <isonest/value_type.h>

namespace isonest {
namespace {

struct Names {
    std::string_view full;
    std::string_view brief;
    std::string_view alias;
};
/// In the order of ValueType.
constexpr std::array<Names, 8> kNames{{{"uint8", "u8", "uchar"},
                                       {"int8", "i8", "char"},
                                       {"uint16", "u16", "ushort"},
                                       {"int16", "i16", "short"},
                                       {"uint32", "u32", "uint"},
                                       {"int32", "i32", "int"},
                                       {"float32", "f32", "float"},
                                       {"float64", "f64", "double"}}};
// NOLINTNEXTLINE(bugprone-macro-parentheses): a term of a sum
#define ISONEST_COUNT(tag, T) +1
static_assert(kNames.size() == 0 ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_COUNT));
#undef ISONEST_COUNT

}  // namespace

std::size_t size_of(ValueType type) {
    return dispatch(type, [](auto tag) { return sizeof(typename decltype(tag)::type); });
}

std::string_view name_of(ValueType type) {
    return kNames.at(static_cast<std::size_t>(type)).full;
}

std::optional<ValueType> value_type_from_name(std::string_view name) {
    for (std::size_t i = 0; i < kNames.size(); ++i) {
        if (name == kNames[i].full || name == kNames[i].brief || name == kNames[i].alias) {
            return static_cast<ValueType>(i);
        }
    }
    return std::nullopt;
}

}  // namespace isonest
