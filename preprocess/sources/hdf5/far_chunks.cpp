#include "preprocess/sources/hdf5/far_chunks.h"

#include <fmt/format.h>

#include <isonest/error.h>

#include "store/hdf5/bytes_driver.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

/// Places that are remembered: some megabytes.
constexpr std::size_t kMostPlaces = std::size_t{1} << 16U;

}  // namespace

FarChunks::FarChunks(const InputFile& file, hid_t dataset, const DatasetShape& shape,
                     const std::vector<hsize_t>& chunk, std::uint64_t most_stored)
    : dataset_(dataset),
      shape_(shape),
      chunk_dims_(chunk),
      nodes_(shape.along_axes(shape.dims)),
      chunk_(shape.along_axes(chunk)),
      grid_(ceil_div(nodes_, chunk_)),
      most_stored_(most_stored),
      ahead_(file, nodes_, [this](const Slab& slab, std::vector<ByteRange>& ranges) {
          add_ranges(slab, ranges);
      }) {}

void FarChunks::add_ranges(const Slab& slab, std::vector<ByteRange>& ranges) {
    const Int3 first{0, slab.y0 / chunk_.y, slab.z0 / chunk_.z};
    const Int3 end = ceil_div(Int3{nodes_.x, slab.y0 + slab.ny, slab.z0 + slab.nz}, chunk_);
    const Int3 count = end - first;
    // Those of the slab that is read come first, and stay until the next one is begun.
    if (ranges.empty() && places_.size() > kMostPlaces) {
        places_.clear();
    }
    for (std::int64_t i = 0; i < count.product(); ++i) {
        const Int3 at = first + count.unlinear(i);
        auto found = places_.find(grid_.linear(at));
        if (found == places_.end()) {
            found = places_.emplace(grid_.linear(at), look_up(at)).first;
        }
        if (found->second.size > 0) {
            ranges.push_back({found->second.offset, found->second.size});
        }
    }
}

void FarChunks::fail(const ErrorPlace& where) const {
    rethrow_failed_read(dataset_);
    throw Error(ErrorKind::io, where, "cannot be found: " + hdf5_message());
}

FarChunks::Place FarChunks::look_up(const Int3& chunk) {
    const QuietHdf5 quiet;
    std::vector<hsize_t> at =
        shape_.along_dims({chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z}, 0);
    for (std::size_t d = 0; d < shape_.at.size(); ++d) {
        at[d] += shape_.at[d] / chunk_dims_[d] * chunk_dims_[d];
    }
    Place place;
    const ErrorPlace where{fmt::format("the chunk from node {} {} {} on", chunk.x * chunk_.x,
                                       chunk.y * chunk_.y, chunk.z * chunk_.z)};
    const std::optional<hsize_t> stored = stored_size_of_chunk(dataset_, at);
    if (!stored) {
        fail(where);
    }
    const hsize_t size = *stored;
    if (size == 0) {
        rethrow_failed_read(dataset_);
        return place;
    }
    if (size > most_stored_) {
        throw Error(ErrorKind::corrupt, where,
                    fmt::format("takes {} bytes, at most {} would be right", size, most_stored_));
    }
    unread_.resize(size);
    herr_t done = 0;
    const std::vector<ByteRange> reads = raw_reads_of(dataset_, [&] {
        done = H5Dread_chunk(dataset_, H5P_DEFAULT, at.data(), &place.skipped, unread_.data());
    });
    if (done < 0 || reads.size() != 1 || reads[0].size != size) {
        fail(where);
    }
    place.offset = reads[0].offset;
    place.size = size;
    rethrow_failed_read(dataset_);
    if (place.size > 0 && !lies_within(place.offset, place.size, ahead_.bytes().size())) {
        throw Error(ErrorKind::corrupt, where,
                    "lies beyond the end of the object; was it cut short?");
    }
    return place;
}

}  // namespace isonest::detail
