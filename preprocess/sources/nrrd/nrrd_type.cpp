#include "preprocess/sources/nrrd/nrrd_type.h"

#include <map>

namespace isonest::detail {

std::optional<NrrdType> nrrd_type(const std::string& name) {
    static const std::map<std::string, NrrdType> types{
        {"signed char", {ValueType::i8}},
        {"int8", {ValueType::i8}},
        {"int8_t", {ValueType::i8}},
        {"char", {ValueType::i8}},
        {"uchar", {ValueType::u8}},
        {"unsigned char", {ValueType::u8}},
        {"uint8", {ValueType::u8}},
        {"uint8_t", {ValueType::u8}},
        {"short", {ValueType::i16}},
        {"short int", {ValueType::i16}},
        {"signed short", {ValueType::i16}},
        {"signed short int", {ValueType::i16}},
        {"int16", {ValueType::i16}},
        {"int16_t", {ValueType::i16}},
        {"ushort", {ValueType::u16}},
        {"unsigned short", {ValueType::u16}},
        {"unsigned short int", {ValueType::u16}},
        {"uint16", {ValueType::u16}},
        {"uint16_t", {ValueType::u16}},
        {"int", {ValueType::i32}},
        {"signed int", {ValueType::i32}},
        {"int32", {ValueType::i32}},
        {"int32_t", {ValueType::i32}},
        {"uint", {ValueType::u32}},
        {"unsigned int", {ValueType::u32}},
        {"uint32", {ValueType::u32}},
        {"uint32_t", {ValueType::u32}},
        {"float", {ValueType::f32}},
        {"double", {ValueType::f64}},
        {"longlong", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"long long", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"long long int", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"signed long long", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"signed long long int", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"int64", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"int64_t", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"ulonglong", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"unsigned long long", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"unsigned long long int", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"uint64", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"uint64_t", {bits_type(StoredNumber::u64), StoredNumber::u64}}};
    const auto it = types.find(name);
    return it == types.end() ? std::nullopt : std::optional(it->second);
}

}  // namespace isonest::detail
