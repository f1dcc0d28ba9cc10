// Chunks of an HDF5 dataset, decoded by many threads. Private to preprocess.
//
// HDF5 decodes under its one lock; here it only hands out the stored bytes.
#pragma once

#include <hdf5.h>

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/int3.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/hdf5/far_chunks.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"

namespace isonest::detail {

/// A chunked dataset whose filters are among shuffle, deflate, zstd, LZF and fletcher32.
/// Thread-safety: none; read() itself uses many threads.
class Hdf5Chunks {
  public:
    /// `chunk`: nodes per chunk and axis of the file. `file`: that of the dataset; of one
    /// elsewhere, chunks are announced ahead and read without HDF5. Up to `heap` bytes are used for
    /// decoding, and more only if one thread needs more. None if HDF5 has to decode (other filters
    /// or another order of them, numbers that are not stored as `memory_type` has them).
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
    /// The stored bytes of a chunk; none if it was never written. Gives the filters that it did not
    /// go through.
    std::uint32_t load(const Int3& chunk, std::vector<std::byte>& stored) const;
    /// The numbers of a chunk, in one of the buffers.
    std::span<const std::byte> decode(const Int3& chunk, Buffers& buffers) const;
    /// Whether the filters of a chunk were left out because it reaches beyond the dataset.
    [[nodiscard]] bool is_plain(const Int3& chunk) const;
    void undo(H5Z_filter_t filter, const Int3& chunk, Buffers& buffers) const;

    hid_t dataset_ = H5I_INVALID_HID;  ///< not owned
    std::string name_;
    DatasetShape shape_;
    Int3 nodes_{1, 1, 1};
    Int3 chunk_{1, 1, 1};
    Int3 stride_{1, 1, 1};        ///< from node to node within a chunk, in elements
    std::vector<hsize_t> fixed_;  ///< where the chunks begin along axes of one position
    std::int64_t first_ = 0;      ///< elements of a chunk before that position
    std::size_t element_ = 1;
    std::size_t chunk_bytes_ = 0;
    std::vector<H5Z_filter_t> filters_;  ///< in the order of writing
    bool plain_edges_ = false;           ///< chunks that reach beyond the dataset are not filtered
    bool long_chunks_ = false;           ///< each of them does, as the dataset is shorter than one
    std::vector<std::byte> fill_;        ///< one element
    std::uint64_t heap_ = 0;
    int decoders_ = 1;
    std::unique_ptr<FarChunks> far_;
};

}  // namespace isonest::detail
