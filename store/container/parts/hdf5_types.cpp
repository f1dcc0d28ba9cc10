#include "store/container/parts/hdf5_types.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include <isonest/error.h>

#include "store/base/checksum.h"
#include "store/bytes/store_bytes.h"
#include "store/container/format.h"
#include "store/container/parts/cube_range_table.h"
#include "store/container/parts/header_reader.h"
#include "store/hdf5/file_drivers.h"

namespace isonest::detail {
namespace {

void write_array(hid_t object, const char* name, hid_t file_type, hid_t memory_type,
                 const void* data, hsize_t count, bool scalar) {
    const SpaceHandle space(scalar ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr));
    const AttributeHandle attribute(
        H5Aexists(object, name) > 0
            ? H5Aopen(object, name, H5P_DEFAULT)
            : H5Acreate2(object, name, file_type, space.get(), H5P_DEFAULT, H5P_DEFAULT));
    if (!attribute.valid() || H5Awrite(attribute.get(), memory_type, data) < 0) {
        throw Error(ErrorKind::io, fmt::format("cannot write the attribute {} of a store: {}", name,
                                               hdf5_message()));
    }
}

template <class T>
std::optional<std::vector<T>> read_array(hid_t object, const char* name, hid_t memory_type,
                                         std::size_t count, bool integer) {
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name, H5P_DEFAULT));
    if (!attribute.valid()) {
        return std::nullopt;
    }
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const TypeHandle type(H5Aget_type(attribute.get()));
    const H5T_class_t kind = H5Tget_class(type.get());
    if (H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(count) ||
        (kind != H5T_INTEGER && (integer || kind != H5T_FLOAT))) {
        return std::nullopt;
    }
    std::vector<T> values(count);
    if (H5Aread(attribute.get(), memory_type, values.data()) < 0) {
        return std::nullopt;
    }
    return values;
}

}  // namespace

FileHandle open_hdf5_of(const StoreBytes& bytes) {
    if (bytes.is_remote()) {
        return open_hdf5(std::shared_ptr<const StoreBytes>(std::shared_ptr<void>(), &bytes));
    }
    return open_hdf5(std::filesystem::path(bytes.name()));
}

TypeHandle file_type(ValueType type) {
    return dispatch(type, [](auto tag) {
        using T = typename decltype(tag)::type;
        if constexpr (std::is_floating_point_v<T>) {
            return TypeHandle(H5Tcopy(sizeof(T) == 4 ? H5T_IEEE_F32LE : H5T_IEEE_F64LE));
        } else {
            TypeHandle integer(H5Tcopy(std::is_signed_v<T> ? H5T_STD_I8LE : H5T_STD_U8LE));
            H5Tset_size(integer.get(), sizeof(T));
            H5Tset_precision(integer.get(), 8 * sizeof(T));
            return integer;
        }
    });
}

TypeHandle indicator_code_type() {
    TypeHandle type(H5Tcopy(H5T_IEEE_F32LE));
    H5Tset_fields(type.get(), 15, 7, 8, 0, 7);
    H5Tset_offset(type.get(), 0);
    H5Tset_precision(type.get(), 16);
    H5Tset_size(type.get(), 2);
    H5Tset_ebias(type.get(), 127);
    return type;
}

TypeHandle chunk_row_type() {
    TypeHandle type(H5Tcreate(H5T_COMPOUND, sizeof(ChunkRow)));
    H5Tinsert(type.get(), "offset", offsetof(ChunkRow, offset), H5T_STD_U64LE);
    H5Tinsert(type.get(), "bytes", offsetof(ChunkRow, bytes), H5T_STD_U32LE);
    H5Tinsert(type.get(), "flags", offsetof(ChunkRow, flags), H5T_STD_U32LE);
    H5Tinsert(type.get(), "checksum", offsetof(ChunkRow, checksum), H5T_STD_U64LE);
    H5Tinsert(type.get(), "min", offsetof(ChunkRow, min), H5T_IEEE_F64LE);
    H5Tinsert(type.get(), "max", offsetof(ChunkRow, max), H5T_IEEE_F64LE);
    return type;
}

TypeHandle label_row_type(std::size_t name_bytes) {
    TypeHandle type(H5Tcreate(H5T_COMPOUND, LabelRow::kName + name_bytes));
    constexpr std::array<hsize_t, 1> kComponents{std::tuple_size_v<LabelColor>};
    const TypeHandle color(H5Tarray_create2(H5T_STD_U8LE, 1, kComponents.data()));
    const TypeHandle text(H5Tcopy(H5T_C_S1));
    H5Tset_size(text.get(), name_bytes);
    H5Tset_strpad(text.get(), H5T_STR_NULLPAD);
    H5Tset_cset(text.get(), H5T_CSET_UTF8);
    H5Tinsert(type.get(), "id", LabelRow::kId, H5T_STD_I64LE);
    H5Tinsert(type.get(), "flags", LabelRow::kFlags, H5T_STD_U8LE);
    H5Tinsert(type.get(), "color", LabelRow::kColor, color.get());
    H5Tinsert(type.get(), "name", LabelRow::kName, text.get());
    return type;
}

std::array<hsize_t, 4> dims_of(const Int3& n, int components) {
    return {static_cast<hsize_t>(n.z), static_cast<hsize_t>(n.y), static_cast<hsize_t>(n.x),
            static_cast<hsize_t>(components)};
}

int rank_of(const ArrayInfo& array) {
    return array.field == Field::values ? 3 : 4;
}

std::optional<std::uint64_t> offset_of(hid_t dataset, std::uint64_t size,
                                       std::uint64_t file_bytes) {
    const haddr_t offset = H5Dget_offset(dataset);
    return offset != HADDR_UNDEF && H5Dget_storage_size(dataset) == size &&
                   lies_within(offset, size, file_bytes)
               ? std::optional<std::uint64_t>(offset)
               : std::nullopt;
}

void write_attribute(hid_t object, const char* name, std::uint32_t value) {
    write_array(object, name, H5T_STD_U32LE, H5T_NATIVE_UINT32, &value, 1, true);
}
void write_attribute(hid_t object, const char* name, std::uint64_t value) {
    write_array(object, name, H5T_STD_U64LE, H5T_NATIVE_UINT64, &value, 1, true);
}
void write_attribute(hid_t object, const char* name, const std::string& value) {
    const TypeHandle type(H5Tcopy(H5T_C_S1));
    H5Tset_size(type.get(), std::max<std::size_t>(value.size(), 1));
    H5Tset_strpad(type.get(), H5T_STR_NULLPAD);
    write_array(object, name, type.get(), type.get(), value.c_str(), 1, true);
}
void write_attribute(hid_t object, const char* name, const std::vector<std::uint32_t>& values) {
    write_array(object, name, H5T_STD_U32LE, H5T_NATIVE_UINT32, values.data(), values.size(),
                false);
}
void write_attribute(hid_t object, const char* name, const std::vector<std::uint64_t>& values) {
    write_array(object, name, H5T_STD_U64LE, H5T_NATIVE_UINT64, values.data(), values.size(),
                false);
}
void write_attribute(hid_t object, const char* name, const std::vector<std::int64_t>& values) {
    write_array(object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, values.data(), values.size(), false);
}
void write_attribute(hid_t object, const char* name, const std::vector<double>& values) {
    write_array(object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values.data(), values.size(),
                false);
}

std::optional<std::vector<std::uint64_t>> read_integers(hid_t object, const char* name,
                                                        std::size_t count) {
    return read_array<std::uint64_t>(object, name, H5T_NATIVE_UINT64, count, true);
}
std::optional<std::vector<double>> read_numbers(hid_t object, const char* name, std::size_t count) {
    return read_array<double>(object, name, H5T_NATIVE_DOUBLE, count, false);
}

std::optional<std::string> read_text(hid_t object, const char* name) {
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name, H5P_DEFAULT));
    if (!attribute.valid()) {
        return std::nullopt;
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const std::size_t size = H5Tget_size(type.get());
    const SpaceHandle space(H5Aget_space(attribute.get()));
    if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0 ||
        size > 4096 || H5Sget_simple_extent_npoints(space.get()) != 1) {
        return std::nullopt;
    }
    std::string text(size, '\0');
    if (H5Aread(attribute.get(), type.get(), text.data()) < 0) {
        return std::nullopt;
    }
    text.resize(text.find_last_not_of('\0') + 1);
    return text;
}

std::optional<std::uint64_t> header_digest(hid_t root) {
    constexpr std::size_t kLongest = 8192;
    const QuietHdf5 quiet;
    Checksum sum;
    for (const char* const name : kDigested) {
        const AttributeHandle attribute(H5Aopen(root, name, H5P_DEFAULT));
        if (!attribute.valid()) {
            return std::nullopt;
        }
        const TypeHandle type(H5Aget_type(attribute.get()));
        const H5T_class_t kind = H5Tget_class(type.get());
        const hsize_t size = H5Aget_storage_size(attribute.get());
        if ((kind != H5T_INTEGER && kind != H5T_FLOAT && kind != H5T_STRING) ||
            H5Tis_variable_str(type.get()) > 0 || size > kLongest) {
            return std::nullopt;
        }
        std::vector<std::byte> bytes(size);
        if (H5Aread(attribute.get(), type.get(), bytes.data()) < 0) {
            return std::nullopt;
        }
        sum.add(bytes);
    }
    return sum.value();
}

}  // namespace isonest::detail
