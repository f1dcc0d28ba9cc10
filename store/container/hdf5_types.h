// HDF5 types and attributes as the store uses them. Private to the store.
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

/// Opens the HDF5 part of a store for reading; `bytes` must outlive the handle. Invalid where HDF5
/// cannot. Of a store that is far away, what is then read has to stand in reading(). Throws
/// Error{io}.
FileHandle open_hdf5_of(const StoreBytes& bytes);

/// Little endian type of the values.
TypeHandle file_type(ValueType type);
/// Little endian 16-bit float with 8 exponent bits: what an indicator code is.
TypeHandle indicator_code_type();
/// The compound of ChunkRow.
TypeHandle chunk_row_type();

/// The compound of a row of the names of labels, with so many bytes for the name.
TypeHandle label_row_type(std::size_t name_bytes);

/// Nodes in HDF5's order, z y x, and behind them the components; an array has rank_of() of them.
std::array<hsize_t, 4> dims_of(const Int3& n, int components);
int rank_of(const ArrayInfo& array);

/// Attributes of fixed type; failures throw Error{io}.
void write_attribute(hid_t object, const char* name, std::uint32_t value);
void write_attribute(hid_t object, const char* name, std::uint64_t value);
void write_attribute(hid_t object, const char* name, const std::string& value);
void write_attribute(hid_t object, const char* name, const std::vector<std::uint32_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<std::uint64_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<std::int64_t>& values);
void write_attribute(hid_t object, const char* name, const std::vector<double>& values);

/// Where a dataset begins that lies in a file of `file_bytes` in one piece; nothing if it does not,
/// or has another size than `size` bytes.
std::optional<std::uint64_t> offset_of(hid_t dataset, std::uint64_t size, std::uint64_t file_bytes);

/// Empty if the attribute is missing or not `count` numbers; never allocates more than that.
std::optional<std::vector<std::uint64_t>> read_integers(hid_t object, const char* name,
                                                        std::size_t count);
std::optional<std::vector<double>> read_numbers(hid_t object, const char* name, std::size_t count);
/// Empty if the attribute is missing or not a fixed-length text of at most 4096 bytes.
std::optional<std::string> read_text(hid_t object, const char* name);

/// XXH64 of the header's attributes, `version` to `has_missing` (FORMAT.md, section 2); empty if
/// one is missing or of another kind.
std::optional<std::uint64_t> header_digest(hid_t root);

}  // namespace isonest::detail
