#include "preprocess/sources/hdf5/hdf5_chunks.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <functional>
#include <thread>

#include <isonest/error.h>

#include "preprocess/sources/hdf5/lzf_filter.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

/// What is read of a chunk at most: filters that do not gain add a little.
std::size_t most_stored(std::size_t chunk_bytes) {
    return chunk_bytes + chunk_bytes / 8 + 4096;
}

/// In the order of writing: a shuffle, one compression, a checksum, each of which may be left out.
/// None for others, and for a shuffle of other elements.
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

/// HDF5's form of Fletcher's checksum: of big endian pairs of bytes.
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

/// Takes the checksum off the end; false if it is not that of the bytes before. HDF5 before 1.6.3
/// wrote its halves with their bytes swapped.
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

/// Numbers that lie `stride` of them apart, one behind the other.
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
        // A chunk that reaches beyond the dataset along an axis of one position.
        c.long_chunks_ = c.long_chunks_ || (shape.at[d] > 0 && begin + chunk[d] > shape.dims[d]);
    }
    c.stride_ = shape.along_axes(strides);
    c.chunk_bytes_ = elements * c.element_;
    c.fill_.resize(c.element_);
    if (H5Pget_fill_value(creation.get(), memory_type, c.fill_.data()) < 0) {
        return std::nullopt;
    }
    const std::uint64_t each = 2 * most_stored(c.chunk_bytes_);
    c.decoders_ = static_cast<int>(std::clamp<std::uint64_t>(
        heap / each, 1, std::max(std::thread::hardware_concurrency(), 1U)));
    c.heap_ = each * static_cast<std::uint64_t>(c.decoders_);
    if (file.is_far()) {
        c.far_ =
            std::make_unique<FarChunks>(file, dataset, shape, chunk, most_stored(c.chunk_bytes_));
        c.heap_ += most_stored(c.chunk_bytes_);
    }
    return c;
}

ErrorPlace Hdf5Chunks::place(const Int3& chunk) const {
    return {name_, fmt::format("the chunk from node {} {} {} on", chunk.x * chunk_.x,
                               chunk.y * chunk_.y, chunk.z * chunk_.z)};
}

void Hdf5Chunks::undo(H5Z_filter_t filter, const Int3& chunk, Buffers& buffers) const {
    if (filter == H5Z_FILTER_SHUFFLE && element_ == 1) {
        return;
    }
    auto& [in, out] = buffers;
    if (filter == H5Z_FILTER_FLETCHER32) {
        if (!take_checksum(in)) {
            throw Error(ErrorKind::corrupt, place(chunk),
                        "has not the checksum that was stored with it", {{RemedyKind::good_copy}});
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
        throw Error(ErrorKind::corrupt, place(chunk), "cannot be decoded",
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
    if (far_ != nullptr) {
        const FarChunks::Place& place = far_->find(chunk);
        stored.resize(place.size);
        far_->bytes().read(place.offset, stored.data(), stored.size());
        return place.skipped;
    }
    std::vector<hsize_t> at =
        shape_.along_dims({chunk.x * chunk_.x, chunk.y * chunk_.y, chunk.z * chunk_.z}, 0);
    std::transform(at.begin(), at.end(), fixed_.begin(), at.begin(), std::plus<>());
    const std::optional<hsize_t> size = stored_size_of_chunk(dataset_, at);
    if (!size) {
        throw Error(ErrorKind::io, place(chunk), "cannot be found: " + hdf5_message());
    }
    if (*size > most_stored(chunk_bytes_)) {
        throw Error(ErrorKind::corrupt, place(chunk),
                    fmt::format("takes {} bytes, its numbers only {}", *size, chunk_bytes_));
    }
    stored.resize(*size);
    std::uint32_t skipped = 0;
    if (*size > 0 && H5Dread_chunk(dataset_, H5P_DEFAULT, at.data(), &skipped, stored.data()) < 0) {
        throw Error(ErrorKind::io, place(chunk), "cannot be read: " + hdf5_message());
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
        throw Error(ErrorKind::corrupt, place(chunk), "has not the size of a chunk");
    }
    return buffers.stored;
}

void Hdf5Chunks::read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                      std::byte* dst) {
    const Int3 first{0, y0 / chunk_.y, z0 / chunk_.z};
    const Int3 end = ceil_div(Int3{nodes_.x, y0 + ny, z0 + nz}, chunk_);
    const Int3 count = end - first;
    if (far_ != nullptr) {
        far_->begin({z0, nz, y0, ny});
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
