#include "preprocess/hdf5_chunks.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <thread>

#include "store/codec.h"
#include "store/error.h"
#include "store/format.h"
#include "store/handles.h"

namespace isonest {
namespace {

/// What is read of a chunk at most: filters that do not gain add a little.
std::size_t most_stored(std::size_t chunk_bytes) {
    return chunk_bytes + chunk_bytes / 8 + 4096;
}

/// In the order of writing; none if one is not ours to undo, as a shuffle of other elements.
std::optional<std::vector<H5Z_filter_t>> filters_of(hid_t creation, std::size_t element) {
    std::vector<H5Z_filter_t> filters;
    const int count = H5Pget_nfilters(creation);
    for (int i = 0; i < count; ++i) {
        unsigned flags = 0;
        unsigned configuration = 0;
        unsigned number = 0;
        std::size_t numbers = 1;
        const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags,
                                                   &numbers, &number, 0, nullptr, &configuration);
        const bool shuffle = filter == H5Z_FILTER_SHUFFLE && number == element;
        if (!shuffle && filter != H5Z_FILTER_DEFLATE &&
            filter != static_cast<H5Z_filter_t>(kZstdFilter)) {
            return std::nullopt;
        }
        filters.push_back(filter);
    }
    return filters;
}

}  // namespace

std::optional<Hdf5Chunks> Hdf5Chunks::open(hid_t dataset, std::string name,
                                           const DatasetShape& shape,
                                           const std::vector<hsize_t>& chunk, hid_t memory_type,
                                           std::uint64_t heap) {
    const QuietHdf5 quiet;
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    const TypeHandle stored(H5Dget_type(dataset));
    const std::size_t element = H5Tget_size(memory_type);
    auto filters = filters_of(creation.get(), element);
    if (!filters || H5Tequal(stored.get(), memory_type) <= 0) {
        return std::nullopt;
    }
    Hdf5Chunks c;
    c.dataset_ = dataset;
    c.name_ = std::move(name);
    c.shape_ = shape;
    c.element_ = element;
    c.filters_ = std::move(*filters);
    std::vector<hsize_t> strides(chunk.size());
    hsize_t elements = 1;
    for (std::size_t i = chunk.size(); i-- > 0;) {
        strides[i] = elements;
        elements *= chunk[i];
    }
    c.nodes_ = shape.along_axes(shape.dims);
    c.chunk_ = shape.along_axes(chunk);
    c.stride_ = shape.along_axes(strides);
    if (c.stride_.x != 1) {
        return std::nullopt;
    }
    c.chunk_bytes_ = elements * c.element_;
    c.fill_.resize(c.element_);
    if (H5Pget_fill_value(creation.get(), memory_type, c.fill_.data()) < 0) {
        return std::nullopt;
    }
    const std::uint64_t each = 2 * most_stored(c.chunk_bytes_);
    c.decoders_ = static_cast<int>(std::clamp<std::uint64_t>(
        heap / each, 1, std::max(std::thread::hardware_concurrency(), 1U)));
    c.heap_ = each * static_cast<std::uint64_t>(c.decoders_);
    return c;
}

std::string Hdf5Chunks::place(const Int3& chunk) const {
    return fmt::format("{}: the chunk from node {} {} {} on", name_, chunk.x * chunk_.x,
                       chunk.y * chunk_.y, chunk.z * chunk_.z);
}

void Hdf5Chunks::undo(H5Z_filter_t filter, const Int3& chunk, Buffers& buffers) const {
    if (filter == H5Z_FILTER_SHUFFLE && element_ == 1) {
        return;
    }
    auto& [in, out] = buffers;
    out.resize(chunk_bytes_);
    bool whole = false;
    if (filter == H5Z_FILTER_SHUFFLE) {
        whole = in.size() == chunk_bytes_;
        if (whole) {
            unshuffle(in, out.data(), element_);
        }
    } else if (filter == H5Z_FILTER_DEFLATE) {
        uLongf size = out.size();
        whole = ::uncompress(reinterpret_cast<Bytef*>(out.data()), &size,
                             reinterpret_cast<const Bytef*>(in.data()), in.size()) == Z_OK &&
                size == out.size();
    } else {
        whole = decompress(in, out);
    }
    if (!whole) {
        throw Error(ErrorKind::corrupt,
                    place(chunk) + " cannot be decoded; restore the file from a good copy");
    }
    std::swap(in, out);
}

std::span<const std::byte> Hdf5Chunks::decode(const Int3& chunk, Buffers& buffers) const {
    const std::vector<hsize_t> at =
        shape_.along_dims({chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z}, 0);
    haddr_t address = HADDR_UNDEF;
    hsize_t size = 0;
    std::uint32_t skipped = 0;
    if (H5Dget_chunk_info_by_coord(dataset_, at.data(), &skipped, &address, &size) < 0) {
        throw Error(ErrorKind::io, place(chunk) + " cannot be found: " + hdf5_message());
    }
    if (address == HADDR_UNDEF) {
        buffers.stored.resize(chunk_bytes_);
        for (std::size_t i = 0; i < chunk_bytes_; i += element_) {
            std::memcpy(buffers.stored.data() + i, fill_.data(), element_);
        }
        return buffers.stored;
    }
    if (size > most_stored(chunk_bytes_)) {
        throw Error(ErrorKind::corrupt, fmt::format("{} takes {} bytes, its numbers only {}",
                                                    place(chunk), size, chunk_bytes_));
    }
    buffers.stored.resize(size);
    if (H5Dread_chunk(dataset_, H5P_DEFAULT, at.data(), &skipped, buffers.stored.data()) < 0) {
        throw Error(ErrorKind::io, place(chunk) + " cannot be read: " + hdf5_message());
    }
    for (std::size_t i = filters_.size(); i-- > 0;) {
        if ((skipped >> i & 1U) == 0) {
            undo(filters_[i], chunk, buffers);
        }
    }
    if (buffers.stored.size() != chunk_bytes_) {
        throw Error(ErrorKind::corrupt, place(chunk) + " has not the size of a chunk");
    }
    return buffers.stored;
}

void Hdf5Chunks::read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) {
    const Int3 first{0, y0 / chunk_.y, z0 / chunk_.z};
    const Int3 end = ceil_div(Int3{nodes_.x, y0 + ny, z0 + nz}, chunk_);
    const Int3 count = end - first;
    std::atomic<std::int64_t> next{0};
    tbb::parallel_for(0, decoders_, [&](int /*decoder*/) {
        const QuietHdf5 quiet;
        Buffers buffers;
        for (std::int64_t i = next++; i < count.product(); i = next++) {
            const Int3 chunk = first + count.unlinear(i);
            const std::span<const std::byte> from = decode(chunk, buffers);
            const Int3 low{chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z};
            const Int3 lo = max(low, {0, y0, z0});
            const Int3 hi = min(low + chunk_, {nodes_.x, y0 + ny, z0 + nz});
            const auto row = static_cast<std::size_t>(hi.x - lo.x) * element_;
            for (std::int64_t z = lo.z; z < hi.z; ++z) {
                for (std::int64_t y = lo.y; y < hi.y; ++y) {
                    const std::int64_t source = (z - low.z) * stride_.z + (y - low.y) * stride_.y;
                    const std::int64_t target = ((z - z0) * ny + (y - y0)) * nodes_.x + lo.x;
                    std::memcpy(dst + static_cast<std::size_t>(target) * element_,
                                from.data() + static_cast<std::size_t>(source) * element_, row);
                }
            }
        }
    });
}

}  // namespace isonest
