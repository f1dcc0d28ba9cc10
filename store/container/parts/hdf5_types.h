// HDF5 types and attributes of a store. Private to the store.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/value_type.h>

#include "store/bytes/store_bytes.h"
#include "store/container/format.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Opens the HDF5 part of a store for reading; `bytes` must outlive the handle. The handle is
/// invalid if HDF5 fails. Later reads from a remote store must be wrapped in reading(). Throws
/// Error{io}.
FileHandle open_hdf5_of(const StoreBytes& bytes);

/// The values' type in little endian.
TypeHandle file_type(ValueType type);
/// The type of an indicator code: a little endian 16-bit float with 8 exponent bits.
TypeHandle indicator_code_type();
/// The compound type of ChunkRow.
TypeHandle chunk_row_type();

/// The compound type of a row of label names with `name_bytes` bytes for the name.
TypeHandle label_row_type(std::size_t name_bytes);

/// Dimensions in HDF5's order: nodes z y x, then components. An array has rank_of() dimensions.
std::array<hsize_t, 4> dims_of(const Int3& n, int components);
int rank_of(const ArrayInfo& array);

/// Write attributes of fixed type; throw Error{io} on failure.
void write_attribute(hid_t object, const char* name, std::uint32_t value);
void write_attribute(hid_t object, const char* name, std::uint64_t value);
void write_attribute(hid_t object, const char* name, const std::string& value);
void write_attribute(hid_t object, const char* name, const std::vector<std::uint32_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<std::uint64_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<std::int64_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<double>& values);

/// Offset of a contiguous dataset in a file of `file_bytes`; nullopt if it is not contiguous, or
/// its size is not `size` bytes.
std::optional<std::uint64_t> offset_of(hid_t dataset, std::uint64_t size, std::uint64_t file_bytes);

/// Nullopt if the attribute is missing or does not have `count` numbers; never allocates more than
/// that.
std::optional<std::vector<std::uint64_t>> read_integers(hid_t object, const char* name,
                                                        std::size_t count);
std::optional<std::vector<double>> read_numbers(hid_t object, const char* name, std::size_t count);
/// Nullopt if the attribute is missing or not a fixed-length text of at most 4096 bytes.
std::optional<std::string> read_text(hid_t object, const char* name);

/// XXH64 of the header's attributes, `version` to `has_missing` (FORMAT.md, section 2); nullopt if
/// one is missing or has another type.
std::optional<std::uint64_t> header_digest(hid_t root);

}  // namespace isonest::detail
