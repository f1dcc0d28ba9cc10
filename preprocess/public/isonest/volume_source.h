// Where a volume comes from: HDF5, raw or NRRD files, read in slabs, every input byte once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>

namespace isonest {

/// A scalar volume that can be read in slabs of whole or partial planes.
/// Thread-safety: one thread at a time.
class VolumeSource {
  public:
    VolumeSource() = default;
    VolumeSource(const VolumeSource&) = delete;
    VolumeSource& operator=(const VolumeSource&) = delete;
    virtual ~VolumeSource() = default;

    /// Number of nodes per axis (x, y, z), each >= 1.
    [[nodiscard]] virtual Int3 nodes() const = 0;
    [[nodiscard]] virtual ValueType type() const = 0;
    /// Node distance per axis in world units, as the file or the options say: what cannot be is
    /// refused by preprocess() (why_no_place()).
    [[nodiscard]] virtual Double3 spacing() const = 0;
    /// World position of node (0, 0, 0).
    [[nodiscard]] virtual Double3 origin() const = 0;
    /// "file:dataset" or the like, for messages.
    [[nodiscard]] virtual std::string name() const = 0;

    /// All files that it reads, also those that only say where others are, none of which may be the
    /// output. The one that was opened comes first.
    [[nodiscard]] virtual std::vector<std::filesystem::path> files() const { return {}; }
    /// What tells this input from another one, line by line, without reading it: the state of its
    /// files, and how they are read. A run that goes on with what another one left needs the same.
    /// Beside it come nodes(), type(), spacing() and origin().
    [[nodiscard]] virtual std::string identity() const;

    /// Reading in multiples of this many planes (z) and rows (y), starting at multiples of it, is
    /// cheap; other reads may decode the same input chunk again. {1, 1} where it does not matter.
    struct Granularity {
        std::int64_t planes = 1;
        std::int64_t rows = 1;
    };
    [[nodiscard]] virtual Granularity granularity() const = 0;
    /// True if reads must come in ascending order without gaps (a gzip stream).
    [[nodiscard]] virtual bool sequential() const = 0;
    /// Bytes that the source may hold beside what it reads into.
    [[nodiscard]] virtual std::uint64_t heap() const { return 1U << 20U; }
    /// The whole volume as read() would give it, in a read-only map of the file; empty if the file
    /// does not hold it that way (compressed, chunked, foreign byte order).
    [[nodiscard]] virtual std::span<const std::byte> mapped() const { return {}; }

    /// Reads rows [y0, y0 + ny) of planes [z0, z0 + nz), whole rows in x, native endianness, x
    /// fastest, tightly packed, into dst (nz * ny * nodes().x * size_of(type()) bytes).
    /// REQUIRES: the range lies inside the volume; in ascending order if sequential().
    /// Throws Error{io, corrupt}.
    virtual void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) = 0;
};

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
                                          const SourceOptions& options);

}  // namespace isonest
