// Volumes in files: HDF5, NRRD and raw numbers.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <isonest/int3.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest {

/// How to interpret an input that does not describe itself, or to override what it says.
struct SourceOptions {
    std::string dataset;                  ///< HDF5: path of the dataset; empty = the only one
    std::optional<Int3> dims;             ///< raw: nodes per axis
    std::optional<ValueType> type;        ///< raw: value type
    std::optional<bool> big_endian;       ///< raw: instead of little
    std::optional<std::uint64_t> offset;  ///< raw: bytes to skip (of the decompressed stream)
    std::optional<Double3> spacing;       ///< overrides the file's
    std::optional<Double3> origin;        ///< overrides the file's
    std::optional<double> missing;        ///< this value stands for missing data
    std::uint64_t max_heap = 256u << 20;  ///< a source may not hold more than this many bytes
};

/// Opens `path` as HDF5 (by signature), NRRD (by magic "NRRD000"), or raw (needs dims and type;
/// gzip is recognised by its magic, whatever the file's name). Throws Error{not_found} for a
/// missing file or dataset (listing the datasets there are), Error{invalid_argument} for options
/// that do not fit the file (wrong size: says the expected and the actual byte counts) or its
/// format (dims for HDF5),
/// Error{unsupported} for types or encodings we do not read, Error{corrupt} for damaged headers,
/// Error{limit} if one input chunk exceeds max_heap.
std::unique_ptr<VolumeSource> open_volume(const std::filesystem::path& path,
                                          const SourceOptions& options = {});

}  // namespace isonest
