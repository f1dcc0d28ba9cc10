// Where the chunks of an HDF5 dataset elsewhere lie. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include <isonest/error.h>
#include <isonest/int3.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/slab_ahead.h"

namespace isonest::detail {

/// Finds chunks without reading them, and announces those of slabs.
/// Thread-safety: begin() from one thread at a time; after it, find() and bytes() from any.
class FarChunks {
  public:
    struct Place {
        std::uint64_t offset = 0;   ///< of the object
        std::uint64_t size = 0;     ///< 0: it was never written
        std::uint32_t skipped = 0;  ///< filters that it did not go through
    };
    /// `dataset`: not owned. `chunk`: nodes per chunk and axis of the file.
    FarChunks(const InputFile& file, hid_t dataset, const DatasetShape& shape,
              const std::vector<hsize_t>& chunk, std::uint64_t most_stored);
    FarChunks(const FarChunks&) = delete;
    FarChunks& operator=(const FarChunks&) = delete;
    ~FarChunks() = default;

    /// A slab is about to be read. Throws what reading the file throws, and Error{io, corrupt}.
    void begin(const Slab& slab) { ahead_.begin(slab); }
    /// REQUIRES: the chunk lies in the slab that was begun last.
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
    std::uint64_t most_stored_;
    std::vector<std::byte> unread_;  ///< what HDF5 believes to read into
    std::unordered_map<std::int64_t, Place> places_;
    SlabAhead ahead_;
};

}  // namespace isonest::detail
