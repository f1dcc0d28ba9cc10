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

#include "preprocess/sources/bytes/file_identity.h"
#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

std::uint64_t product(const Lengths& lengths) {
    std::uint64_t all = 1;
    for (const std::uint64_t n : lengths) {
        all *= n;
    }
    return all;
}

class ZarrSource : public VolumeSource {
  public:
    ZarrSource(ZarrImage image, ChosenAxes chosen, Placement place, std::optional<LengthUnit> unit,
               std::uint64_t max_heap, std::string name)
        : image_(std::move(image)),
          chosen_(std::move(chosen)),
          place_(std::move(place)),
          unit_(unit),
          name_(std::move(name)) {
        const ZarrArray& a = array();
        chunk_bytes_ = product(a.chunk.shape) * a.value_bytes();
        if (a.shard) {
            for (std::size_t i = 0; i < a.shape.size(); ++i) {
                per_shard_.push_back(a.shard->shape[i] / a.chunk.shape[i]);
            }
            index_bytes_ = product(per_shard_) * kEntry;
        }
        constexpr std::uint64_t kPackedAndTwice = 3;
        const std::uint64_t one = kPackedAndTwice * chunk_bytes_;
        if (one + index_bytes_ > max_heap) {
            throw Error(ErrorKind::limit, {name_},
                        fmt::format("one chunk of [{}] values{} takes more than {} MiB",
                                    fmt::join(a.chunk.shape, ", "),
                                    a.shard ? " and the index of its shard" : "", max_heap >> 20U),
                        {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
        }
        const std::uint64_t cores = std::max(1U, std::thread::hardware_concurrency());
        at_once_ =
            static_cast<int>(std::clamp<std::uint64_t>((max_heap - index_bytes_) / one, 1, cores));
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
                name_,          place_.direction,
                false,          unit_};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return image_.files; }
    /// Of the chunks the first and the last are looked at.
    [[nodiscard]] std::string identity() const override {
        std::vector<std::filesystem::path> looked_at = image_.files;
        const Lengths& outer = array().shard ? array().shard->shape : array().chunk.shape;
        Lengths last;
        for (std::size_t i = 0; i < outer.size(); ++i) {
            last.push_back((array().shape[i] - 1) / outer[i]);
        }
        looked_at.push_back(array().file_of(Lengths(outer.size(), 0)));
        looked_at.push_back(array().file_of(last));
        return fmt::format("{}zarr at {}\n", identity_of(looked_at), fmt::join(chosen_.at, " "));
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
        return (1U << 20U) + index_bytes_ + 3 * chunk_bytes_ * static_cast<std::uint64_t>(at_once_);
    }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const Request request{{0, y0, z0}, {chosen_.nodes.x, ny, nz}, dst};
        // Chunks that the request touches, per array axis.
        Lengths first;
        Lengths count;
        for (std::size_t i = 0; i < array().shape.size(); ++i) {
            const auto [from, to] = range_on(i, request);
            const std::uint64_t n = array().chunk.shape[i];
            first.push_back(from / n);
            count.push_back((to - 1) / n - from / n + 1);
        }
        if (!array().shard) {
            read_chunks(first, count, request, nullptr);
            return;
        }
        // Shard by shard, as each has an index.
        Lengths shard_first;
        Lengths shard_count;
        for (std::size_t i = 0; i < first.size(); ++i) {
            shard_first.push_back(first[i] / per_shard_[i]);
            shard_count.push_back((first[i] + count[i] - 1) / per_shard_[i] - shard_first[i] + 1);
        }
        for (std::uint64_t s = 0; s < product(shard_count); ++s) {
            const Lengths shard = unlinear(s, shard_first, shard_count);
            Lengths lo;
            Lengths size;
            for (std::size_t i = 0; i < first.size(); ++i) {
                lo.push_back(std::max(first[i], shard[i] * per_shard_[i]));
                size.push_back(std::min(first[i] + count[i], (shard[i] + 1) * per_shard_[i]) -
                               lo[i]);
            }
            const ShardIndex index = read_index(array().file_of(shard));
            read_chunks(lo, size, request, &index);
        }
    }

  private:
    static constexpr std::uint64_t kEntry = 16;  ///< bytes of an index: offset, size
    static constexpr std::uint64_t kNone = ~std::uint64_t{0};

    struct Request {
        Int3 lo;
        Int3 size;
        std::byte* dst;
    };
    struct ShardIndex {
        std::filesystem::path file;
        std::uint64_t size = 0;  ///< of the file
        std::string entries;     ///< empty: there is no file
    };

    [[nodiscard]] const ZarrArray& array() const { return image_.array; }

    /// Which of the volume's axes an array's axis is; none if a position is fixed.
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
    static Lengths unlinear(std::uint64_t i, const Lengths& first, const Lengths& count) {
        Lengths at(first.size());
        for (std::size_t k = first.size(); k-- > 0;) {
            at[k] = first[k] + i % count[k];
            i /= count[k];
        }
        return at;
    }

    void read_chunks(const Lengths& first, const Lengths& count, const Request& request,
                     const ShardIndex* index) const {
        const std::uint64_t all = product(count);
        const auto jobs = static_cast<std::uint64_t>(at_once_);
        tbb::parallel_for(std::uint64_t{0}, jobs, [&](std::uint64_t job) {
            for (std::uint64_t i = job; i < all; i += jobs) {
                read_chunk(unlinear(i, first, count), request, index);
            }
        });
    }

    void read_chunk(const Lengths& chunk, const Request& request, const ShardIndex* index) const {
        const std::string where = fmt::format("chunk [{}]", fmt::join(chunk, ", "));
        std::vector<std::byte> packed =
            index != nullptr ? from_shard(chunk, *index, where) : from_file(chunk, where);
        if (packed.empty()) {
            copy(chunk, request, {});
            return;
        }
        copy(chunk, request,
             decode_zarr(std::move(packed), array().chunk.codecs, chunk_bytes_,
                         name_ + ": " + where));
    }

    /// No more than what a chunk can be packed into; nothing where there is no file.
    [[nodiscard]] std::vector<std::byte> from_file(const Lengths& chunk,
                                                   const std::string& where) const {
        const std::filesystem::path file = array().file_of(chunk);
        std::error_code error;
        if (!std::filesystem::exists(file, error)) {
            return {};
        }
        const std::uint64_t size = regular_file_size(file);
        check_packed(size, where);
        return bytes_at(file, 0, size, where);
    }
    void check_packed(std::uint64_t size, const std::string& where) const {
        constexpr std::uint64_t kBeside = 4096;
        if (size > chunk_bytes_ + chunk_bytes_ / 2 + kBeside) {
            throw Error(ErrorKind::corrupt, {name_, where},
                        fmt::format("{} bytes for a chunk of {}", size, chunk_bytes_));
        }
    }
    [[nodiscard]] std::vector<std::byte> bytes_at(const std::filesystem::path& file,
                                                  std::uint64_t at, std::uint64_t size,
                                                  const std::string& where) const {
        const std::string text = first_bytes(file, static_cast<std::size_t>(size), at);
        if (text.size() != size || size == 0) {
            throw Error(ErrorKind::corrupt, {name_, where}, "its file is too short");
        }
        const auto bytes = std::as_bytes(std::span(text));
        return {bytes.begin(), bytes.end()};
    }

    [[nodiscard]] ShardIndex read_index(const std::filesystem::path& file) const {
        ShardIndex index;
        index.file = file;
        std::error_code error;
        if (!std::filesystem::exists(file, error)) {
            return index;
        }
        const ZarrArray::Shard& shard = *array().shard;
        const std::string where = file.filename().string();
        index.size = regular_file_size(file);
        const std::uint64_t stored = index_bytes_ + 4 * shard.index_codecs.size();
        if (index.size < stored) {
            throw Error(ErrorKind::corrupt, {name_, where}, "a shard shorter than its index");
        }
        const std::vector<std::byte> entries =
            decode_zarr(bytes_at(file, shard.index_at_end ? index.size - stored : 0, stored, where),
                        shard.index_codecs, index_bytes_, name_ + ": index of " + where);
        index.entries.assign(reinterpret_cast<const char*>(entries.data()), entries.size());
        return index;
    }
    [[nodiscard]] std::vector<std::byte> from_shard(const Lengths& chunk, const ShardIndex& index,
                                                    const std::string& where) const {
        if (index.entries.empty()) {
            return {};
        }
        std::uint64_t entry = 0;
        for (std::size_t i = 0; i < chunk.size(); ++i) {
            entry = entry * per_shard_[i] + chunk[i] % per_shard_[i];
        }
        const auto at = number_at<std::uint64_t>(index.entries, entry * kEntry, false);
        const auto size = number_at<std::uint64_t>(index.entries, entry * kEntry + 8, false);
        if (at == kNone && size == kNone) {
            return {};
        }
        check_packed(size, where);
        if (at > index.size || size > index.size - at) {
            throw Error(ErrorKind::corrupt, {name_, where}, "its shard's index leads beyond it");
        }
        return bytes_at(index.file, at, size, where);
    }

    /// What a chunk (nothing: the fill value) has of the request.
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
    std::string name_;
    std::uint64_t chunk_bytes_ = 0;
    Lengths per_shard_;
    std::uint64_t index_bytes_ = 0;
    int at_once_ = 1;
    Lengths strides_;  ///< of values in a decoded chunk, per axis
};

}  // namespace

std::unique_ptr<VolumeSource> zarr_chunks(ZarrImage image, ChosenAxes chosen, Placement place,
                                          std::optional<LengthUnit> unit, std::uint64_t max_heap,
                                          std::string name) {
    return std::make_unique<ZarrSource>(std::move(image), std::move(chosen), std::move(place), unit,
                                        max_heap, std::move(name));
}

}  // namespace isonest::detail
