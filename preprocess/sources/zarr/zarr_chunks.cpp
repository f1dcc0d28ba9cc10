#include "preprocess/sources/zarr/zarr_chunks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <thread>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kEntry = 16;  ///< bytes of an index entry: offset, size
constexpr std::uint64_t kNone = ~std::uint64_t{0};

}  // namespace

std::uint64_t product(const Lengths& lengths) {
    std::uint64_t all = 1;
    for (const std::uint64_t n : lengths) {
        all *= n;
    }
    return all;
}

PackedChunks::PackedChunks(std::shared_ptr<ZarrFiles> files, const ZarrArray& array,
                           std::string name)
    : files_(std::move(files)),
      array_(array),
      name_(std::move(name)),
      chunk_bytes_(product(array.chunk.shape) * array.value_bytes()),
      max_bytes_(max_between(array.chunk.codecs, chunk_bytes_)) {
    if (array.shard) {
        for (std::size_t i = 0; i < array.shape.size(); ++i) {
            per_shard_.push_back(array.shard->shape[i] / array.chunk.shape[i]);
        }
        index_bytes_ = product(per_shard_) * kEntry;
    }
}

std::uint64_t PackedChunks::stored_index_bytes() const {
    constexpr std::uint64_t kChecksum = 4;
    return index_bytes_ + kChecksum * array_.shard->index_codecs.size();
}

std::string PackedChunks::where(const Lengths& chunk) const {
    const std::string indices = fmt::format("chunk [{}]", fmt::join(chunk, ", "));
    return files_->is_remote() && !array_.shard
               ? fmt::format("{} ({})", indices,
                             array_.file_of(chunk).native().substr(name_.size() + 1))
               : indices;
}

PackedChunks::ShardIndex PackedChunks::unpacked(std::filesystem::path file,
                                                ZarrIndexBytes bytes) const {
    ShardIndex index;
    index.size = bytes.file_size;
    index.state = std::move(bytes.state);
    const std::string shown =
        files_->is_remote() ? file.native().substr(name_.size() + 1) : file.filename().string();
    const std::vector<std::byte> entries =
        decode_zarr(std::move(bytes.bytes), array_.shard->index_codecs, index_bytes_,
                    name_ + ": index of " + shown);
    index.entries.assign(reinterpret_cast<const char*>(entries.data()), entries.size());
    index.file = std::move(file);
    return index;
}

PackedChunks::ShardIndex PackedChunks::read_index(const Lengths& shard) const {
    std::filesystem::path file = array_.file_of(shard);
    std::optional<ZarrIndexBytes> bytes =
        files_->index(file, stored_index_bytes(), array_.shard->index_at_end, name_);
    if (!bytes) {
        return {std::move(file), 0, {}};
    }
    return unpacked(std::move(file), *std::move(bytes));
}

std::optional<PackedChunks::ShardIndex> PackedChunks::index_at_hand(const Lengths& shard) const {
    std::filesystem::path file = array_.file_of(shard);
    std::optional<ZarrIndexBytes> bytes =
        files_->index_at_hand(file, stored_index_bytes(), array_.shard->index_at_end);
    return bytes ? std::optional(unpacked(std::move(file), *std::move(bytes))) : std::nullopt;
}

std::optional<ByteRange> PackedChunks::entry_of(const Lengths& chunk,
                                                const ShardIndex& index) const {
    if (index.entries.empty()) {
        return std::nullopt;
    }
    std::uint64_t entry = 0;
    for (std::size_t i = 0; i < chunk.size(); ++i) {
        entry = entry * per_shard_[i] + chunk[i] % per_shard_[i];
    }
    const auto at = number_at<std::uint64_t>(index.entries, entry * kEntry, false);
    const auto size = number_at<std::uint64_t>(index.entries, entry * kEntry + 8, false);
    if (at == kNone && size == kNone) {
        return std::nullopt;
    }
    return ByteRange{at, size};
}

std::vector<std::byte> PackedChunks::read(const Lengths& chunk, const ShardIndex* index) const {
    const ZarrChunkPlace place{name_, where(chunk), max_bytes_};
    if (index == nullptr) {
        std::optional<std::vector<std::byte>> bytes = files_->chunk(array_.file_of(chunk), place);
        if (bytes && bytes->empty()) {
            throw Error(ErrorKind::corrupt, {name_, place.where}, "the file is too short");
        }
        return bytes ? *std::move(bytes) : std::vector<std::byte>();
    }
    const std::optional<ByteRange> range = entry_of(chunk, *index);
    if (!range) {
        return {};
    }
    check_packed(range->size, place);
    if (!lies_within(range->offset, range->size, index->size)) {
        throw Error(ErrorKind::corrupt, {name_, place.where},
                    "the index of the shard points beyond its end");
    }
    return files_->range(index->file, *range, place);
}

std::optional<ZarrPart> PackedChunks::part_of(const Lengths& chunk, const ShardIndex* index) const {
    if (index == nullptr) {
        return ZarrPart{array_.file_of(chunk), ZarrPart::Kind::chunk, {0, max_bytes_}};
    }
    const std::optional<ByteRange> range = entry_of(chunk, *index);
    if (!range || range->size > max_packed(max_bytes_) ||
        !lies_within(range->offset, range->size, index->size)) {
        return std::nullopt;
    }
    return ZarrPart{index->file, ZarrPart::Kind::range, *range};
}

ZarrPart PackedChunks::index_part(const Lengths& shard) const {
    return {
        array_.file_of(shard),
        array_.shard->index_at_end ? ZarrPart::Kind::index_at_end : ZarrPart::Kind::index_at_start,
        {0, stored_index_bytes()}};
}

namespace {

/// Maximum number of chunks, or of shard indices, that are prefetched at a time.
constexpr std::uint64_t kMaxPrefetched = 4096;

class ZarrSource : public VolumeSource {
  public:
    ZarrSource(std::shared_ptr<ZarrFiles> files, ZarrImage image, ChosenAxes chosen,
               Placement place, std::optional<LengthUnit> unit, std::uint64_t max_heap,
               const NeededNodes& needed, std::string name)
        : image_(std::move(image)),
          chosen_(std::move(chosen)),
          place_(place),
          unit_(unit),
          needed_(needed),
          packed_(std::move(files), image_.array, std::move(name)) {
        const ZarrArray& a = array();
        const std::uint64_t index_bytes = packed_.index_bytes();
        constexpr std::uint64_t kPackedAndTwice = 3;
        const std::uint64_t one = kPackedAndTwice * packed_.max_bytes() +
                                  beside_codecs(a.chunk.codecs, packed_.max_bytes());
        if (one + index_bytes > max_heap) {
            throw Error(ErrorKind::limit, {packed_.name()},
                        fmt::format("one chunk of [{}] values{} needs more than {} MiB of memory",
                                    fmt::join(a.chunk.shape, ", "),
                                    a.shard ? " and the index of its shard" : "", max_heap >> 20U),
                        {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
        }
        const std::uint64_t cores = std::max(1U, std::thread::hardware_concurrency());
        at_once_ =
            static_cast<int>(std::clamp<std::uint64_t>((max_heap - index_bytes) / one, 1, cores));
        strides_.assign(a.shape.size(), 0);
        std::uint64_t stride = 1;
        for (std::size_t i = a.chunk.order.size(); i-- > 0;) {
            strides_[a.chunk.order[i]] = stride;
            stride *= a.chunk.shape[a.chunk.order[i]];
        }
    }

    [[nodiscard]] VolumeDescription describe() const override {
        const ZarrArray& a = array();
        return {chosen_.nodes,  a.stored ? bits_type(*a.stored) : a.type,
                place_.spacing, place_.origin,
                packed_.name(), place_.direction,
                false,          unit_};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return packed_.files().files(image_.files);
    }
    [[nodiscard]] FetchedCounts fetched() const override { return packed_.files().fetched(); }
    /// In a folder, the first and the last chunk are examined.
    [[nodiscard]] std::string identity() const override {
        const Lengths& outer = array().shard ? array().shard->shape : array().chunk.shape;
        Lengths last;
        for (std::size_t i = 0; i < outer.size(); ++i) {
            last.push_back((array().shape[i] - 1) / outer[i]);
        }
        const std::string files = packed_.files().identity(
            image_.files, {array().file_of(Lengths(outer.size(), 0)), array().file_of(last)});
        return fmt::format("{}zarr at {}\n", files, fmt::join(chosen_.at, " "));
    }
    [[nodiscard]] Granularity granularity() const override {
        const auto along = [&](std::size_t a) -> std::int64_t {
            return chosen_.axis.at(a) ? static_cast<std::int64_t>(std::min<std::uint64_t>(
                                            array().chunk.shape[*chosen_.axis.at(a)],
                                            array().shape[*chosen_.axis.at(a)]))
                                      : 1;
        };
        return {along(2), along(1)};
    }
    [[nodiscard]] std::uint64_t heap() const override {
        return (1U << 20U) + packed_.index_bytes() +
               (3 * packed_.max_bytes() +
                beside_codecs(array().chunk.codecs, packed_.max_bytes())) *
                   static_cast<std::uint64_t>(at_once_);
    }

    void will_read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny) override {
        if (packed_.files().is_remote()) {
            expected_ = Request{{0, y0, z0}, {chosen_.nodes.x, ny, nz}, nullptr};
        }
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const Request request{{0, y0, z0}, {chosen_.nodes.x, ny, nz}, dst};
        const Box chunks = chunks_of(request);
        if (packed_.files().is_remote()) {
            want(chunks, Wait::for_indices);
            want_expected();
        }
        if (!array().shard) {
            read_chunks(chunks, request, nullptr);
        } else {
            // Shard by shard, as each has its own index.
            const Box shards = shards_of(chunks);
            for (std::uint64_t s = 0; s < product(shards.count); ++s) {
                const Lengths shard = unlinear(s, shards);
                const Box inside = part_in(chunks, shard);
                if (needs_any(inside)) {
                    const PackedChunks::ShardIndex index = packed_.read_index(shard);
                    read_chunks(inside, request, &index);
                } else {
                    read_chunks(inside, request, nullptr);
                }
            }
        }
        leave_out_read(request);
        want_expected();
    }

  private:
    struct Request {
        Int3 lo;
        Int3 size;
        std::byte* dst;
    };
    /// A box of chunks, or of shards: those from `first` on, per array axis.
    struct Box {
        Lengths first;
        Lengths count;
    };
    enum class Wait : std::uint8_t { for_indices, not_at_all };

    [[nodiscard]] const ZarrArray& array() const { return image_.array; }

    /// The volume's axis for an array's axis; none if its position is fixed.
    [[nodiscard]] std::optional<int> volume_axis(std::size_t axis) const {
        for (int a = 0; a < 3; ++a) {
            if (chosen_.axis.at(static_cast<std::size_t>(a)) == axis) {
                return a;
            }
        }
        return std::nullopt;
    }
    [[nodiscard]] std::pair<std::uint64_t, std::uint64_t> range_on(std::size_t axis,
                                                                   const Request& r) const {
        if (const auto a = volume_axis(axis)) {
            return {static_cast<std::uint64_t>(r.lo[*a]),
                    static_cast<std::uint64_t>(r.lo[*a] + r.size[*a])};
        }
        const auto at = static_cast<std::uint64_t>(chosen_.at[axis]);
        return {at, at + 1};
    }
    static Lengths unlinear(std::uint64_t i, const Box& box) {
        Lengths at(box.first.size());
        for (std::size_t k = box.first.size(); k-- > 0;) {
            at[k] = box.first[k] + i % box.count[k];
            i /= box.count[k];
        }
        return at;
    }
    [[nodiscard]] Box chunks_of(const Request& request) const {
        Box box;
        for (std::size_t i = 0; i < array().shape.size(); ++i) {
            const auto [from, to] = range_on(i, request);
            const std::uint64_t n = array().chunk.shape[i];
            box.first.push_back(from / n);
            box.count.push_back((to - 1) / n - from / n + 1);
        }
        return box;
    }
    [[nodiscard]] Box shards_of(const Box& chunks) const {
        Box box;
        for (std::size_t i = 0; i < chunks.first.size(); ++i) {
            const std::uint64_t n = packed_.per_shard()[i];
            box.first.push_back(chunks.first[i] / n);
            box.count.push_back((chunks.first[i] + chunks.count[i] - 1) / n - box.first[i] + 1);
        }
        return box;
    }
    /// Those of these chunks that are in a shard.
    [[nodiscard]] Box part_in(const Box& chunks, const Lengths& shard) const {
        Box box;
        for (std::size_t i = 0; i < chunks.first.size(); ++i) {
            const std::uint64_t n = packed_.per_shard()[i];
            box.first.push_back(std::max(chunks.first[i], shard[i] * n));
            box.count.push_back(std::min(chunks.first[i] + chunks.count[i], (shard[i] + 1) * n) -
                                box.first[i]);
        }
        return box;
    }
    /// Whether the caller needs any node of these chunks.
    [[nodiscard]] bool needs_any(const Box& chunks) const {
        for (std::size_t i = 0; i < chunks.first.size(); ++i) {
            const std::uint64_t n = array().chunk.shape[i];
            const auto begin = static_cast<std::int64_t>(chunks.first[i] * n);
            const auto end = static_cast<std::int64_t>(
                std::min((chunks.first[i] + chunks.count[i]) * n, array().shape[i]));
            const auto a = volume_axis(i);
            if (a && !needed_.any(*a, begin, end)) {
                return false;
            }
        }
        return true;
    }
    [[nodiscard]] bool needs(const Lengths& chunk) const {
        return needs_any({chunk, Lengths(chunk.size(), 1)});
    }

    /// Prefetches the chunks from number `from` to `to`, as many as may be prefetched.
    void want_some(const Box& chunks, std::uint64_t from, std::uint64_t to,
                   const PackedChunks::ShardIndex* index) const {
        std::vector<ZarrPart> parts;
        for (std::uint64_t i = from; i < to && parts.size() < kMaxPrefetched; ++i) {
            const Lengths chunk = unlinear(i, chunks);
            if (needs(chunk)) {
                if (auto part = packed_.part_of(chunk, index)) {
                    parts.push_back(*std::move(part));
                }
            }
        }
        packed_.files().want(parts);
    }
    /// False: some shard indices are not available yet, and only these were prefetched.
    bool want(const Box& chunks, Wait wait) const {
        if (!array().shard) {
            want_some(chunks, 0, product(chunks.count), nullptr);
            return true;
        }
        const Box box = shards_of(chunks);
        std::vector<Lengths> shards;
        std::vector<ZarrPart> indices;
        for (std::uint64_t s = 0; s < product(box.count) && shards.size() < kMaxPrefetched; ++s) {
            const Lengths shard = unlinear(s, box);
            if (needs_any(part_in(chunks, shard))) {
                shards.push_back(shard);
                indices.push_back(packed_.index_part(shard));
            }
        }
        packed_.files().want(indices);
        bool all = true;
        for (const Lengths& shard : shards) {
            const auto index = wait == Wait::for_indices ? packed_.read_index(shard)
                                                         : packed_.index_at_hand(shard);
            const Box inside = part_in(chunks, shard);
            if (index) {
                want_some(inside, 0, product(inside.count), &*index);
            }
            all = all && index;
        }
        return all;
    }
    /// Removes what was read meanwhile from a prefetch that could not be requested yet: it may
    /// already be evicted, and would be fetched again.
    void leave_out_read(const Request& done) {
        if (!expected_ || done.lo.y > expected_->lo.y ||
            done.lo.y + done.size.y < expected_->lo.y + expected_->size.y ||
            done.lo.z > expected_->lo.z) {
            return;
        }
        const std::int64_t end = expected_->lo.z + expected_->size.z;
        expected_->lo.z = std::max(expected_->lo.z, done.lo.z + done.size.z);
        expected_->size.z = end - expected_->lo.z;
        if (expected_->size.z <= 0) {
            expected_.reset();
        }
    }
    void want_expected() {
        if (expected_ && want(chunks_of(*expected_), Wait::not_at_all)) {
            expected_.reset();
        }
    }

    void read_chunks(const Box& chunks, const Request& request,
                     const PackedChunks::ShardIndex* index) const {
        const std::uint64_t all = product(chunks.count);
        const bool is_remote = packed_.files().is_remote();
        const std::uint64_t batch = is_remote ? std::min(all, kMaxPrefetched) : all;
        const auto jobs = static_cast<std::uint64_t>(at_once_);
        for (std::uint64_t from = 0; from < all; from += batch) {
            const std::uint64_t to = std::min(all, from + batch);
            if (is_remote && to < all) {
                want_some(chunks, to, std::min(all, to + batch), index);
            }
            tbb::parallel_for(std::uint64_t{0}, jobs, [&](std::uint64_t job) {
                for (std::uint64_t i = from + job; i < to; i += jobs) {
                    read_chunk(unlinear(i, chunks), request, index);
                }
            });
        }
    }

    void read_chunk(const Lengths& chunk, const Request& request,
                    const PackedChunks::ShardIndex* index) const {
        std::vector<std::byte> packed =
            needs(chunk) ? packed_.read(chunk, index) : std::vector<std::byte>();
        if (packed.empty()) {
            copy(chunk, request, {});
            return;
        }
        copy(chunk, request,
             decode_zarr(std::move(packed), array().chunk.codecs, packed_.chunk_bytes(),
                         packed_.name() + ": " + packed_.where(chunk)));
    }

    /// Copies the part of a chunk (empty: the fill value) that belongs to the request.
    void copy(const Lengths& chunk, const Request& request,
              std::span<const std::byte> values) const {
        const std::size_t value = array().value_bytes();
        Int3 from = request.lo;
        Int3 to = request.lo + request.size;
        Int3 low{0, 0, 0};   ///< of the chunk, along the volume's axes
        Int3 step{0, 0, 0};  ///< values in the chunk
        std::uint64_t base = 0;
        for (std::size_t i = 0; i < chunk.size(); ++i) {
            const std::uint64_t begin = chunk[i] * array().chunk.shape[i];
            if (const auto a = volume_axis(i)) {
                low[*a] = static_cast<std::int64_t>(begin);
                from[*a] = std::max(from[*a], low[*a]);
                to[*a] =
                    std::min(to[*a], static_cast<std::int64_t>(begin + array().chunk.shape[i]));
                step[*a] = static_cast<std::int64_t>(strides_[i]);
            } else {
                base += (static_cast<std::uint64_t>(chosen_.at[i]) - begin) * strides_[i];
            }
        }
        for (std::int64_t z = from.z; z < to.z; ++z) {
            for (std::int64_t y = from.y; y < to.y; ++y) {
                const Int3 at = Int3{from.x, y, z} - request.lo;
                std::byte* out =
                    request.dst + static_cast<std::size_t>(request.size.linear(at)) * value;
                const auto count = static_cast<std::size_t>(to.x - from.x);
                if (values.empty()) {
                    for (std::size_t x = 0; x < count; ++x) {
                        std::memcpy(out + x * value, array().fill.data(), value);
                    }
                    continue;
                }
                const std::uint64_t first =
                    base + static_cast<std::uint64_t>((from.x - low.x) * step.x +
                                                      (y - low.y) * step.y + (z - low.z) * step.z);
                copy_row(values.data() + first * value, step.x, count, value, out);
            }
        }
    }
    void copy_row(const std::byte* in, std::int64_t step, std::size_t count, std::size_t value,
                  std::byte* out) const {
        if (step == 1 || count == 1) {
            std::memcpy(out, in, count * value);
        } else {
            for (std::size_t x = 0; x < count; ++x) {
                std::memcpy(
                    out + x * value,
                    in + static_cast<std::ptrdiff_t>(x) * step * static_cast<std::ptrdiff_t>(value),
                    value);
            }
        }
        if (array().chunk.big_endian && value > 1) {
            for (std::size_t x = 0; x < count; ++x) {
                std::reverse(out + x * value, out + (x + 1) * value);
            }
        }
    }

    ZarrImage image_;
    ChosenAxes chosen_;
    Placement place_;
    std::optional<LengthUnit> unit_;
    NeededNodes needed_;
    PackedChunks packed_;
    std::optional<Request> expected_;  ///< by will_read(), and not yet requested
    int at_once_ = 1;
    Lengths strides_;  ///< of values in a decoded chunk, per axis
};

}  // namespace

std::unique_ptr<VolumeSource> zarr_chunks(std::shared_ptr<ZarrFiles> files, ZarrImage image,
                                          ChosenAxes chosen, Placement place,
                                          std::optional<LengthUnit> unit, std::uint64_t max_heap,
                                          const NeededNodes& needed, std::string name) {
    return std::make_unique<ZarrSource>(std::move(files), std::move(image), std::move(chosen),
                                        place, unit, max_heap, needed, std::move(name));
}

}  // namespace isonest::detail
