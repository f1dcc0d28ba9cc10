// Chunks of an HDF5 dataset, decoded by many threads. Private to preprocess.
//
// HDF5 decodes under its global lock, so it is only used to return the stored bytes.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include <isonest/error.h>
#include <isonest/int3.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/remote_numbers.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

// HDF5 reads that fail if a number would be rounded.

/// Transfer properties for H5Dread(). The read fails if the requested type cannot hold a number
/// exactly, and then sets `lossy`. REQUIRES: `lossy` outlives the handle.
PropertyHandle exact_transfer(bool& lossy);

// Where the chunks of a remote HDF5 dataset are.

/// Finds chunks without reading them, and prefetches those of slabs.
/// Thread-safety: begin() from one thread at a time; after it, find() and bytes() from any thread.
class RemoteChunks {
  public:
    struct Place {
        std::uint64_t offset = 0;   ///< in the object
        std::uint64_t size = 0;     ///< 0: it was never written
        std::uint32_t skipped = 0;  ///< mask of the filters that were not applied
    };
    /// `dataset`: not owned. `chunk`: nodes per chunk along each axis of the file.
    RemoteChunks(const InputFile& file, hid_t dataset, const DatasetShape& shape,
                 const std::vector<hsize_t>& chunk, std::uint64_t max_stored);
    RemoteChunks(const RemoteChunks&) = delete;
    RemoteChunks& operator=(const RemoteChunks&) = delete;
    ~RemoteChunks() = default;

    /// Called before a slab is read. Throws what reading the file throws, and Error{io, corrupt}.
    void begin(const Slab& slab) { ahead_.begin(slab); }
    /// REQUIRES: the chunk lies in the slab of the last begin().
    [[nodiscard]] const Place& find(const Int3& chunk) const {
        return places_.at(grid_.linear(chunk));
    }
    [[nodiscard]] ReadAhead& bytes() { return ahead_.bytes(); }
    [[nodiscard]] const Int3& chunk() const { return chunk_; }

  private:
    void add_ranges(const Slab& slab, std::vector<ByteRange>& ranges);
    [[noreturn]] void fail(const ErrorPlace& where) const;
    [[nodiscard]] Place look_up(const Int3& chunk);

    hid_t dataset_;
    DatasetShape shape_;
    std::vector<hsize_t> chunk_dims_;
    Int3 nodes_;
    Int3 chunk_;
    Int3 grid_;
    std::uint64_t max_stored_;
    std::vector<std::byte> unread_;  ///< dummy destination of HDF5's read
    std::unordered_map<std::int64_t, Place> places_;
    SlabAhead ahead_;
};

// Contiguous remote HDF5 datasets.

/// A type as HDF5 has it in memory (little endian), and the volume's type.
struct Hdf5Number {
    hid_t memory_type;
    ValueType type;
};

/// Reads the numbers by byte ranges, without HDF5, in either byte order. Null if they are not
/// contiguous, or are stored as another type: then HDF5 has to read them. Throws Error{corrupt} if
/// the object ends before them, and what open_remote_numbers() throws.
std::unique_ptr<VolumeSource> open_remote_contiguous(const InputFile& file, hid_t dataset,
                                                     const DatasetShape& shape,
                                                     const Hdf5Number& number,
                                                     const std::string& name);

/// A chunked dataset whose filters are among shuffle, deflate, zstd, LZF and fletcher32.
/// Thread-safety: none; read() itself uses many threads.
class Hdf5Chunks {
  public:
    /// `chunk`: nodes per chunk along each axis of the file. `file`: that of the dataset; if it is
    /// remote, chunks are prefetched and read without HDF5. Up to `heap` bytes are used for
    /// decoding, and more only if a single thread needs more. None if HDF5 has to decode (other
    /// filters or another order of them, numbers that are not stored as `memory_type`).
    static std::optional<Hdf5Chunks> open(hid_t dataset, std::string name,
                                          const DatasetShape& shape,
                                          const std::vector<hsize_t>& chunk, hid_t memory_type,
                                          std::uint64_t heap, const InputFile& file);

    [[nodiscard]] std::uint64_t heap() const { return heap_; }
    /// See VolumeSource::read(). Throws Error{io, corrupt}.
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny, std::byte* dst);

  private:
    struct Buffers {
        std::vector<std::byte> stored;
        std::vector<std::byte> decoded;
    };
    Hdf5Chunks() = default;
    [[nodiscard]] ErrorPlace place(const Int3& chunk) const;
    /// Loads the stored bytes of a chunk; none if it was never written. Returns the mask of filters
    /// that were not applied.
    std::uint32_t load(const Int3& chunk, std::vector<std::byte>& stored) const;
    /// The numbers of a chunk, in one of the buffers.
    std::span<const std::byte> decode(const Int3& chunk, Buffers& buffers) const;
    /// Whether the chunk is unfiltered because it extends beyond the dataset.
    [[nodiscard]] bool is_plain(const Int3& chunk) const;
    void undo(H5Z_filter_t filter, const Int3& chunk, Buffers& buffers) const;

    hid_t dataset_ = H5I_INVALID_HID;  ///< not owned
    std::string name_;
    DatasetShape shape_;
    Int3 nodes_{1, 1, 1};
    Int3 chunk_{1, 1, 1};
    Int3 stride_{1, 1, 1};        ///< from node to node within a chunk, in elements
    std::vector<hsize_t> fixed_;  ///< start of the chunks along axes with one position
    std::int64_t first_ = 0;      ///< elements of a chunk before that position
    std::size_t element_ = 1;
    std::size_t chunk_bytes_ = 0;
    std::vector<H5Z_filter_t> filters_;  ///< in the order of writing
    bool plain_edges_ = false;           ///< chunks that extend beyond the dataset are not filtered
    bool long_chunks_ = false;           ///< all chunks do, as the dataset is shorter than one
    std::vector<std::byte> fill_;        ///< one element
    std::uint64_t heap_ = 0;
    int decoders_ = 1;
    std::unique_ptr<RemoteChunks> remote_;
};

}  // namespace isonest::detail
