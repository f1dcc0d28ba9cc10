#include "preprocess/sources/zarr/packed_chunks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_number.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kEntry = 16;  ///< bytes of an index: offset, size
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
      most_bytes_(most_between(array.chunk.codecs, chunk_bytes_)) {
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
    return files_->is_far() && !array_.shard
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
        files_->is_far() ? file.native().substr(name_.size() + 1) : file.filename().string();
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
    const ZarrChunkPlace place{name_, where(chunk), most_bytes_};
    if (index == nullptr) {
        std::optional<std::vector<std::byte>> bytes = files_->chunk(array_.file_of(chunk), place);
        if (bytes && bytes->empty()) {
            throw Error(ErrorKind::corrupt, {name_, place.where}, "its file is too short");
        }
        return bytes ? *std::move(bytes) : std::vector<std::byte>();
    }
    const std::optional<ByteRange> range = entry_of(chunk, *index);
    if (!range) {
        return {};
    }
    check_packed(range->size, place);
    if (!lies_within(range->offset, range->size, index->size)) {
        throw Error(ErrorKind::corrupt, {name_, place.where}, "its shard's index leads beyond it");
    }
    return files_->range(index->file, *range, place);
}

std::optional<ZarrPart> PackedChunks::part_of(const Lengths& chunk, const ShardIndex* index) const {
    if (index == nullptr) {
        return ZarrPart{array_.file_of(chunk), ZarrPart::Kind::chunk, {0, most_bytes_}};
    }
    const std::optional<ByteRange> range = entry_of(chunk, *index);
    if (!range || range->size > most_packed(most_bytes_) ||
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

}  // namespace isonest::detail
