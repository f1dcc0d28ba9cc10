#include "preprocess/sources/hdf5/hdf5_chunks.h"

#include <fmt/format.h>
#include <hdf5.h>
#include <oneapi/tbb/parallel_for.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <thread>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/hdf5/lzf_filter.h"
#include "preprocess/sources/numbers/remote_numbers.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

/// HDF5 reports all negative 64-bit integers as inexact in float64; checks whether this one is
/// exact.
bool is_exact(hid_t from, const void* in, void* out) {
    constexpr std::size_t kSize = 8;
    if (H5Tget_class(from) != H5T_INTEGER || H5Tget_sign(from) != H5T_SGN_2 ||
        H5Tget_size(from) != kSize || H5Tget_precision(from) != 8 * kSize) {
        return false;
    }
    std::array<std::byte, kSize> bytes{};
    std::memcpy(bytes.data(), in, kSize);
    if (H5Tget_order(from) != H5Tget_order(H5T_NATIVE_INT64)) {
        std::reverse(bytes.begin(), bytes.end());
    }
    std::int64_t value = 0;
    std::memcpy(&value, bytes.data(), kSize);
    constexpr std::int64_t kMax = std::int64_t{1} << 53U;
    if (value < -kMax || value > kMax) {
        return false;
    }
    const auto converted = static_cast<double>(value);
    std::memcpy(out, &converted, kSize);
    return true;
}

H5T_conv_ret_t stop_if_lossy(H5T_conv_except_t kind, hid_t from, hid_t /*to*/, void* in, void* out,
                             void* lossy) {
    if (kind == H5T_CONV_EXCEPT_PRECISION && is_exact(from, in, out)) {
        return H5T_CONV_HANDLED;
    }
    if (kind != H5T_CONV_EXCEPT_PRECISION && kind != H5T_CONV_EXCEPT_RANGE_HI &&
        kind != H5T_CONV_EXCEPT_RANGE_LOW && kind != H5T_CONV_EXCEPT_TRUNCATE) {
        return H5T_CONV_UNHANDLED;
    }
    *static_cast<bool*>(lossy) = true;
    return H5T_CONV_ABORT;
}

}  // namespace

PropertyHandle exact_transfer(bool& lossy) {
    PropertyHandle transfer(H5Pcreate(H5P_DATASET_XFER));
    H5Pset_type_conv_cb(transfer.get(), &stop_if_lossy, &lossy);
    return transfer;
}

namespace {

/// Maximum number of places that are remembered: some megabytes.
constexpr std::size_t kMaxPlaces = std::size_t{1} << 16U;

}  // namespace

RemoteChunks::RemoteChunks(const InputFile& file, hid_t dataset, const DatasetShape& shape,
                           const std::vector<hsize_t>& chunk, std::uint64_t max_stored)
    : dataset_(dataset),
      shape_(shape),
      chunk_dims_(chunk),
      nodes_(shape.along_axes(shape.dims)),
      chunk_(shape.along_axes(chunk)),
      grid_(ceil_div(nodes_, chunk_)),
      max_stored_(max_stored),
      ahead_(file, nodes_, [this](const Slab& slab, std::vector<ByteRange>& ranges) {
          add_ranges(slab, ranges);
      }) {}

void RemoteChunks::add_ranges(const Slab& slab, std::vector<ByteRange>& ranges) {
    const Int3 first{0, slab.y0 / chunk_.y, slab.z0 / chunk_.z};
    const Int3 end = ceil_div(Int3{nodes_.x, slab.y0 + slab.ny, slab.z0 + slab.nz}, chunk_);
    const Int3 count = end - first;
    // The slab being read comes first; its places stay until the next slab begins.
    if (ranges.empty() && places_.size() > kMaxPlaces) {
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

void RemoteChunks::fail(const ErrorPlace& where) const {
    rethrow_failed_read(dataset_);
    throw Error(ErrorKind::io, where, "cannot find the chunk: " + hdf5_message());
}

RemoteChunks::Place RemoteChunks::look_up(const Int3& chunk) {
    const QuietHdf5 quiet;
    std::vector<hsize_t> at =
        shape_.along_dims({chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z}, 0);
    for (std::size_t d = 0; d < shape_.at.size(); ++d) {
        at[d] += shape_.at[d] / chunk_dims_[d] * chunk_dims_[d];
    }
    Place place;
    const ErrorPlace where{fmt::format("chunk at node {} {} {}", chunk.x * chunk_.x,
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
    if (size > max_stored_) {
        throw Error(
            ErrorKind::corrupt, where,
            fmt::format("the chunk has {} bytes, but at most {} are possible", size, max_stored_));
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
                    "the chunk lies beyond the end of the object; was the object cut short?");
    }
    return place;
}

std::unique_ptr<VolumeSource> open_remote_contiguous(const InputFile& file, hid_t dataset,
                                                     const DatasetShape& shape,
                                                     const Hdf5Number& number,
                                                     const std::string& name) {
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    const TypeHandle stored(H5Dget_type(dataset));
    const haddr_t offset = offset_of_values(dataset);
    const TypeHandle swapped(H5Tcopy(number.memory_type));
    H5Tset_order(swapped.get(), H5T_ORDER_BE);
    RawLayout layout;
    layout.big_endian = H5Tequal(stored.get(), swapped.get()) > 0;
    if (H5Pget_layout(creation.get()) != H5D_CONTIGUOUS || offset == HADDR_UNDEF ||
        (!layout.big_endian && H5Tequal(stored.get(), number.memory_type) <= 0)) {
        return nullptr;
    }
    std::vector<hsize_t> strides(shape.dims.size());
    hsize_t values = 1;
    const std::uint64_t size = file.bytes()->size();
    const auto require = [&](bool fits) {
        if (!fits) {
            throw Error(ErrorKind::corrupt, {name}, "the object ends before the dataset does");
        }
    };
    for (std::size_t i = shape.dims.size(); i-- > 0;) {
        require(values <= size / shape.dims[i]);
        strides[i] = values;
        layout.first += shape.at.empty() ? 0 : shape.at[i] * values;
        values *= shape.dims[i];
    }
    layout.nodes = shape.along_axes(shape.dims);
    layout.type = number.type;
    layout.offset = offset;
    require(values <= size / size_of(layout.type) &&
            lies_within(offset, values * size_of(layout.type), size));
    if (values != static_cast<hsize_t>(layout.nodes.product()) ||
        !std::is_sorted(shape.axes.begin(), shape.axes.end())) {
        layout.strides = shape.along_axes(strides);
        layout.whole = values;
    }
    return open_remote_numbers(file, name, layout);
}

namespace {

/// Maximum of bytes read for a chunk: filters that do not gain add a little.
std::size_t max_stored(std::size_t chunk_bytes) {
    return chunk_bytes + chunk_bytes / 8 + 4096;
}

/// In the order of writing: a shuffle, one compression, a checksum, each optional. None for other
/// filters, and for a shuffle of elements of another size.
std::optional<std::vector<H5Z_filter_t>> filters_of(hid_t creation, std::size_t element) {
    std::vector<H5Z_filter_t> filters;
    int last = 0;
    const int count = H5Pget_nfilters(creation);
    for (int i = 0; i < count; ++i) {
        unsigned flags = 0;
        unsigned configuration = 0;
        unsigned number = 0;
        std::size_t numbers = 1;
        const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags,
                                                   &numbers, &number, 0, nullptr, &configuration);
        const bool shuffle = filter == H5Z_FILTER_SHUFFLE && number == element;
        const bool compression = filter == H5Z_FILTER_DEFLATE ||
                                 filter == static_cast<H5Z_filter_t>(kZstdFilter) ||
                                 (filter == kLzfFilter && has_lzf());
        const int place = shuffle ? 1 : compression ? 2 : filter == H5Z_FILTER_FLETCHER32 ? 3 : 0;
        if (place <= last) {
            return std::nullopt;
        }
        last = place;
        filters.push_back(filter);
    }
    return filters;
}

/// HDF5's variant of Fletcher's checksum, over big-endian pairs of bytes.
std::uint32_t fletcher32(std::span<const std::byte> bytes) {
    constexpr std::size_t kWithoutOverflow = 360;
    std::uint32_t first = 0;
    std::uint32_t second = 0;
    const auto fold = [](std::uint32_t sum) { return (sum & 0xFFFFU) + (sum >> 16U); };
    const std::size_t pairs = bytes.size() / 2;
    for (std::size_t i = 0; i < pairs;) {
        const std::size_t end = std::min(pairs, i + kWithoutOverflow);
        for (; i < end; ++i) {
            first += std::to_integer<std::uint32_t>(bytes[2 * i]) << 8U |
                     std::to_integer<std::uint32_t>(bytes[2 * i + 1]);
            second += first;
        }
        first = fold(first);
        second = fold(second);
    }
    if (bytes.size() % 2 != 0) {
        first += std::to_integer<std::uint32_t>(bytes.back()) << 8U;
        second += first;
        first = fold(first);
        second = fold(second);
    }
    return fold(second) << 16U | fold(first);
}

/// Removes the checksum from the end; false if it does not match the bytes before it. HDF5 before
/// 1.6.3 wrote its halves with swapped bytes.
bool take_checksum(std::vector<std::byte>& bytes) {
    std::uint32_t stored = 0;
    if (bytes.size() < sizeof(stored)) {
        return false;
    }
    const std::size_t size = bytes.size() - sizeof(stored);
    for (std::size_t i = 0; i < sizeof(stored); ++i) {
        stored |= std::to_integer<std::uint32_t>(bytes[size + i]) << (8 * i);
    }
    bytes.resize(size);
    const std::uint32_t sum = fletcher32(bytes);
    return stored == sum || stored == ((sum & 0xFF00FFU) << 8U | (sum >> 8U & 0xFF00FFU));
}

/// Copies numbers that are `stride` numbers apart to consecutive ones.
void copy_row(const std::byte* from, std::size_t stride, std::byte* to, std::size_t count,
              std::size_t element) {
    if (stride == 1) {
        std::memcpy(to, from, count * element);
        return;
    }
    const auto copy = [&](auto number) {
        using T = decltype(number);
        for (std::size_t i = 0; i < count; ++i) {
            std::memcpy(to + i * sizeof(T), from + i * stride * sizeof(T), sizeof(T));
        }
    };
    switch (element) {
        case 1:
            copy(std::uint8_t{});
            return;
        case 2:
            copy(std::uint16_t{});
            return;
        case 4:
            copy(std::uint32_t{});
            return;
        default:
            copy(std::uint64_t{});
    }
}

}  // namespace

std::optional<Hdf5Chunks> Hdf5Chunks::open(hid_t dataset, std::string name,
                                           const DatasetShape& shape,
                                           const std::vector<hsize_t>& chunk, hid_t memory_type,
                                           std::uint64_t heap, const InputFile& file) {
    const QuietHdf5 quiet;
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    const TypeHandle stored(H5Dget_type(dataset));
    const std::size_t element = H5Tget_size(memory_type);
    auto filters = filters_of(creation.get(), element);
    unsigned edges = 0;
    if (!filters || H5Pget_chunk_opts(creation.get(), &edges) < 0 ||
        H5Tequal(stored.get(), memory_type) <= 0) {
        return std::nullopt;
    }
    Hdf5Chunks c;
    c.dataset_ = dataset;
    c.name_ = std::move(name);
    c.shape_ = shape;
    c.element_ = element;
    c.filters_ = std::move(*filters);
    c.plain_edges_ = (edges & H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS) != 0;
    std::vector<hsize_t> strides(chunk.size());
    hsize_t elements = 1;
    for (std::size_t i = chunk.size(); i-- > 0;) {
        strides[i] = elements;
        elements *= chunk[i];
    }
    c.nodes_ = shape.along_axes(shape.dims);
    c.chunk_ = shape.along_axes(chunk);
    for (std::size_t d = 0; d < chunk.size(); ++d) {
        c.long_chunks_ = c.long_chunks_ || chunk[d] > shape.dims[d];
    }
    c.fixed_.assign(chunk.size(), 0);
    for (std::size_t d = 0; d < shape.at.size(); ++d) {
        const hsize_t begin = shape.at[d] / chunk[d] * chunk[d];
        c.fixed_[d] = begin;
        c.first_ += static_cast<std::int64_t>((shape.at[d] - begin) * strides[d]);
        // A chunk that extends beyond the dataset along an axis with one position.
        c.long_chunks_ = c.long_chunks_ || (shape.at[d] > 0 && begin + chunk[d] > shape.dims[d]);
    }
    c.stride_ = shape.along_axes(strides);
    c.chunk_bytes_ = elements * c.element_;
    c.fill_.resize(c.element_);
    if (H5Pget_fill_value(creation.get(), memory_type, c.fill_.data()) < 0) {
        return std::nullopt;
    }
    const std::uint64_t each = 2 * max_stored(c.chunk_bytes_);
    c.decoders_ = static_cast<int>(std::clamp<std::uint64_t>(
        heap / each, 1, std::max(std::thread::hardware_concurrency(), 1U)));
    c.heap_ = each * static_cast<std::uint64_t>(c.decoders_);
    if (file.is_remote()) {
        c.remote_ =
            std::make_unique<RemoteChunks>(file, dataset, shape, chunk, max_stored(c.chunk_bytes_));
        c.heap_ += max_stored(c.chunk_bytes_);
    }
    return c;
}

ErrorPlace Hdf5Chunks::place(const Int3& chunk) const {
    return {name_, fmt::format("chunk at node {} {} {}", chunk.x * chunk_.x, chunk.y * chunk_.y,
                               chunk.z * chunk_.z)};
}

void Hdf5Chunks::undo(H5Z_filter_t filter, const Int3& chunk, Buffers& buffers) const {
    if (filter == H5Z_FILTER_SHUFFLE && element_ == 1) {
        return;
    }
    auto& [in, out] = buffers;
    if (filter == H5Z_FILTER_FLETCHER32) {
        if (!take_checksum(in)) {
            throw Error(ErrorKind::corrupt, place(chunk), "the checksum is wrong",
                        {{RemedyKind::good_copy}});
        }
        return;
    }
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
    } else if (filter == kLzfFilter) {
        whole = undo_lzf(in, out);
    } else {
        whole = decompress(in, out);
    }
    if (!whole) {
        throw Error(ErrorKind::corrupt, place(chunk), "the chunk cannot be decoded",
                    {{RemedyKind::good_copy}});
    }
    std::swap(in, out);
}

bool Hdf5Chunks::is_plain(const Int3& chunk) const {
    const Int3 end{(chunk.x + 1) * chunk_.x, (chunk.y + 1) * chunk_.y, (chunk.z + 1) * chunk_.z};
    return plain_edges_ &&
           (long_chunks_ || end.x > nodes_.x || end.y > nodes_.y || end.z > nodes_.z);
}

std::uint32_t Hdf5Chunks::load(const Int3& chunk, std::vector<std::byte>& stored) const {
    if (remote_ != nullptr) {
        const RemoteChunks::Place& place = remote_->find(chunk);
        stored.resize(place.size);
        remote_->bytes().read(place.offset, stored.data(), stored.size());
        return place.skipped;
    }
    std::vector<hsize_t> at =
        shape_.along_dims({chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z}, 0);
    std::transform(at.begin(), at.end(), fixed_.begin(), at.begin(), std::plus<>());
    const std::optional<hsize_t> size = stored_size_of_chunk(dataset_, at);
    if (!size) {
        throw Error(ErrorKind::io, place(chunk), "cannot find the chunk: " + hdf5_message());
    }
    if (*size > max_stored(chunk_bytes_)) {
        throw Error(ErrorKind::corrupt, place(chunk),
                    fmt::format("the chunk has {} compressed bytes, but only {} uncompressed bytes",
                                *size, chunk_bytes_));
    }
    stored.resize(*size);
    std::uint32_t skipped = 0;
    if (*size > 0 && H5Dread_chunk(dataset_, H5P_DEFAULT, at.data(), &skipped, stored.data()) < 0) {
        throw Error(ErrorKind::io, place(chunk), "cannot read the chunk: " + hdf5_message());
    }
    return skipped;
}

std::span<const std::byte> Hdf5Chunks::decode(const Int3& chunk, Buffers& buffers) const {
    const std::uint32_t skipped = load(chunk, buffers.stored);
    if (buffers.stored.empty()) {
        buffers.stored.resize(chunk_bytes_);
        for (std::size_t i = 0; i < chunk_bytes_; i += element_) {
            std::memcpy(buffers.stored.data() + i, fill_.data(), element_);
        }
        return buffers.stored;
    }
    for (std::size_t i = is_plain(chunk) ? 0 : filters_.size(); i-- > 0;) {
        if ((skipped >> i & 1U) == 0) {
            undo(filters_[i], chunk, buffers);
        }
    }
    if (buffers.stored.size() != chunk_bytes_) {
        throw Error(ErrorKind::corrupt, place(chunk),
                    "the decoded chunk does not have the expected size");
    }
    return buffers.stored;
}

void Hdf5Chunks::read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) {
    const Int3 first{0, y0 / chunk_.y, z0 / chunk_.z};
    const Int3 end = ceil_div(Int3{nodes_.x, y0 + ny, z0 + nz}, chunk_);
    const Int3 count = end - first;
    if (remote_ != nullptr) {
        remote_->begin({z0, nz, y0, ny});
    }
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
            for (std::int64_t z = lo.z; z < hi.z; ++z) {
                for (std::int64_t y = lo.y; y < hi.y; ++y) {
                    const std::int64_t source =
                        first_ + (z - low.z) * stride_.z + (y - low.y) * stride_.y;
                    const std::int64_t target = ((z - z0) * ny + (y - y0)) * nodes_.x + lo.x;
                    copy_row(from.data() + static_cast<std::size_t>(source) * element_,
                             static_cast<std::size_t>(stride_.x),
                             dst + static_cast<std::size_t>(target) * element_,
                             static_cast<std::size_t>(hi.x - lo.x), element_);
                }
            }
        }
    });
}

}  // namespace isonest::detail
