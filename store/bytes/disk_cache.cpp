#include "store/bytes/disk_cache.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <iterator>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "store/base/checksum.h"
#include "store/bytes/cache_folder.h"

namespace isonest::detail {
namespace {

struct CachedBlockHead {
    std::array<char, 8> letters{};
    std::uint64_t checksum = 0;
    std::uint64_t number = 0;
    std::uint32_t name_bytes = 0;
    std::uint32_t parts = 0;
};
constexpr std::array<char, 8> kCachedBlockLetters{'i', 's', 'o', 'r', 'n', 'g', '0', '1'};
/// The checksum covers everything after it.
constexpr std::size_t kCheckedFrom =
    offsetof(CachedBlockHead, checksum) + sizeof(CachedBlockHead::checksum);

/// memcpy() that accepts null pointers if n is 0.
void copy_bytes(void* to, const void* from, std::size_t n) {
    if (n > 0) {
        std::memcpy(to, from, n);
    }
}

}  // namespace

std::optional<CachedBlock> CachedBlock::decode(std::span<const std::byte> file,
                                               std::string_view object, std::uint64_t number) {
    CachedBlockHead head;
    if (file.size() < sizeof(head) || file.size() > kMaxFileBytes) {
        return std::nullopt;
    }
    std::memcpy(&head, file.data(), sizeof(head));
    if (head.letters != kCachedBlockLetters || head.number != number ||
        head.name_bytes != object.size() || head.parts > kBytes ||
        checksum_of(file.subspan(kCheckedFrom)) != head.checksum) {
        return std::nullopt;
    }
    std::span<const std::byte> rest = file.subspan(sizeof(head));
    const std::size_t part_bytes = head.parts * sizeof(Part);
    if (rest.size() < part_bytes + object.size()) {
        return std::nullopt;
    }
    CachedBlock block;
    block.parts_.resize(head.parts);
    copy_bytes(block.parts_.data(), rest.data(), part_bytes);
    rest = rest.subspan(part_bytes);
    const auto name = std::as_bytes(std::span(object.data(), object.size()));
    if (!std::equal(name.begin(), name.end(), rest.begin())) {
        return std::nullopt;
    }
    rest = rest.subspan(object.size());
    block.bytes_.resize(block.parts_.empty() ? 0 : kBytes);
    std::size_t end = 0;
    for (const Part& part : block.parts_) {
        if (part.from < end || part.end() > kBytes || part.size > rest.size()) {
            return std::nullopt;
        }
        std::memcpy(block.bytes_.data() + part.from, rest.data(), part.size);
        rest = rest.subspan(part.size);
        end = part.end();
    }
    return rest.empty() ? std::optional(std::move(block)) : std::nullopt;
}

std::vector<std::byte> CachedBlock::encode(std::string_view object, std::uint64_t number) const {
    CachedBlockHead head{kCachedBlockLetters, 0, number, static_cast<std::uint32_t>(object.size()),
                         static_cast<std::uint32_t>(parts_.size())};
    std::size_t size = sizeof(head) + parts_.size() * sizeof(Part) + object.size();
    for (const Part& part : parts_) {
        size += part.size;
    }
    if (size > kMaxFileBytes) {
        return {};
    }
    std::vector<std::byte> file(size);
    std::byte* to = file.data() + sizeof(head);
    const auto append = [&](const void* from, std::size_t n) {
        copy_bytes(to, from, n);
        to += n;
    };
    append(parts_.data(), parts_.size() * sizeof(Part));
    append(object.data(), object.size());
    for (const Part& part : parts_) {
        append(bytes_.data() + part.from, part.size);
    }
    std::memcpy(file.data(), &head, sizeof(head));
    head.checksum = checksum_of(std::span(file).subspan(kCheckedFrom));
    std::memcpy(file.data(), &head, sizeof(head));
    return file;
}

bool CachedBlock::has(std::size_t from, std::size_t size) const {
    const auto after = std::find_if(parts_.begin(), parts_.end(),
                                    [&](const Part& part) { return part.end() >= from + size; });
    return size == 0 || (after != parts_.end() && after->from <= from);
}

bool CachedBlock::copy(std::size_t from, std::span<std::byte> to) const {
    if (!has(from, to.size())) {
        return false;
    }
    if (to.empty()) {
        return true;
    }
    std::memcpy(to.data(), bytes_.data() + from, to.size());
    return true;
}

bool CachedBlock::add(std::size_t from, std::span<const std::byte> bytes) {
    if (has(from, bytes.size())) {
        return false;
    }
    bytes_.resize(kBytes);
    std::memcpy(bytes_.data() + from, bytes.data(), bytes.size());
    // Merge it with all parts that overlap or touch it.
    const std::size_t end = from + bytes.size();
    const auto first = std::find_if(parts_.begin(), parts_.end(),
                                    [&](const Part& part) { return part.end() >= from; });
    const auto last =
        std::find_if(first, parts_.end(), [&](const Part& part) { return part.from > end; });
    const std::size_t low = first == last ? from : std::min<std::size_t>(from, first->from);
    const std::size_t high = first == last ? end : std::max(end, std::prev(last)->end());
    const Part joined{static_cast<std::uint32_t>(low), static_cast<std::uint32_t>(high - low)};
    parts_.insert(parts_.erase(first, last), joined);
    return true;
}

void CachedBlock::remove(std::size_t from, std::size_t size) {
    std::vector<Part> left;
    const auto add_part = [&](std::size_t begin, std::size_t end) {
        if (begin < end) {
            left.push_back(
                {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end - begin)});
        }
    };
    for (const Part& part : parts_) {
        add_part(part.from, std::min(part.end(), from));
        add_part(std::max<std::size_t>(part.from, from + size), part.end());
    }
    parts_ = std::move(left);
}

namespace {

class CachedObject : public RangeCache {
  public:
    CachedObject(std::shared_ptr<CacheFolder> folder, const ObjectState& object)
        : folder_(std::move(folder)),
          name_(fmt::format("{}\n{}\n{}{}{}", object.url, object.version, object.size,
                            object.query.empty() ? "" : "\n", object.query)),
          name_checksum_(checksum_of(std::as_bytes(std::span(name_)))),
          size_(object.size) {}

    [[nodiscard]] std::optional<std::vector<std::byte>> load(ByteRange range) override {
        if (!is_inside(range)) {
            return std::nullopt;
        }
        std::vector<std::byte> bytes;
        const bool all = each_piece(range, [&](const Piece& piece) {
            const auto block = last_read(piece.block);
            if (!block) {
                return false;
            }
            bytes.resize(range.size);
            return block->copy(piece.from, std::span(bytes).subspan(piece.at, piece.size));
        });
        return all ? std::optional(std::move(bytes)) : std::nullopt;
    }

    void keep(ByteRange range, std::span<const std::byte> bytes) override {
        if (!is_inside(range) || bytes.size() != range.size) {
            return;
        }
        try {
            each_piece(range, [&](const Piece& piece) {
                // Neighbours that arrive at the same time share a block at their border.
                const std::lock_guard lock(adding_.at(piece.block % adding_.size()));
                CachedBlock block = stored(piece.block).value_or(CachedBlock());
                if (block.add(piece.from, bytes.subspan(piece.at, piece.size))) {
                    const std::vector<std::byte> file = block.encode(name_, piece.block);
                    if (!file.empty()) {
                        folder_->write(number_of(piece.block), file);
                        let_go(piece.block);
                    }
                }
                return true;
            });
        } catch (const std::bad_alloc&) {
            return;  // not kept
        }
    }

    void forget(ByteRange range) override {
        if (!is_inside(range)) {
            return;
        }
        each_piece(range, [&](const Piece& piece) {
            const std::lock_guard lock(adding_.at(piece.block % adding_.size()));
            std::optional<CachedBlock> block = stored(piece.block);
            if (block) {
                block->remove(piece.from, piece.size);
            }
            folder_->remove(number_of(piece.block));
            if (block && !block->empty()) {
                folder_->write(number_of(piece.block), block->encode(name_, piece.block));
            }
            let_go(piece.block);
            return true;
        });
    }

  private:
    /// The part of a range that lies in one block.
    struct Piece {
        std::uint64_t block = 0;
        std::size_t from = 0;  ///< in the block
        std::size_t at = 0;    ///< in the range
        std::size_t size = 0;
    };

    [[nodiscard]] bool is_inside(ByteRange range) const {
        return range.offset <= size_ && range.size <= size_ - range.offset;
    }

    /// Calls f(piece) for the pieces of the range as long as it returns true. Returns whether it
    /// always did.
    template <class F>
    static bool each_piece(ByteRange range, const F& f) {
        for (std::uint64_t done = 0; done < range.size;) {
            const std::uint64_t offset = range.offset + done;
            const auto from = static_cast<std::size_t>(offset % CachedBlock::kBytes);
            const auto size = static_cast<std::size_t>(
                std::min<std::uint64_t>(CachedBlock::kBytes - from, range.size - done));
            if (!f(Piece{offset / CachedBlock::kBytes, from, static_cast<std::size_t>(done),
                         size})) {
                return false;
            }
            done += size;
        }
        return true;
    }

    /// The number of the block's entry.
    [[nodiscard]] std::uint64_t number_of(std::uint64_t block) const {
        const std::array<std::uint64_t, 2> key{name_checksum_, block};
        return checksum_of(std::as_bytes(std::span(key)));
    }

    /// The file of a block in the cache folder.
    struct Entry {
        bool is_there = false;
        std::optional<CachedBlock> block;  ///< nullopt if the file is damaged
    };
    [[nodiscard]] Entry entry(std::uint64_t block) const {
        const auto file = folder_->read(number_of(block), CachedBlock::kMaxFileBytes);
        return file ? Entry{true, CachedBlock::decode(*file, name_, block)} : Entry{};
    }

    /// Removes a damaged entry. REQUIRES: the block's mutex in adding_ is held; otherwise an entry
    /// that has just replaced the damaged one could be removed.
    [[nodiscard]] std::optional<CachedBlock> stored(std::uint64_t block) {
        Entry found = entry(block);
        if (found.is_there && !found.block) {
            folder_->remove(number_of(block));
        }
        return std::move(found.block);
    }
    /// The same without the mutex held.
    [[nodiscard]] std::optional<CachedBlock> stored_now(std::uint64_t block) {
        Entry found = entry(block);
        if (!found.is_there || found.block) {
            return std::move(found.block);
        }
        const std::lock_guard lock(adding_.at(block % adding_.size()));
        return stored(block);
    }

    using BlockPointer = std::shared_ptr<const CachedBlock>;

    /// Adjacent ranges are requested one after the other; this reads their block only once.
    [[nodiscard]] BlockPointer last_read(std::uint64_t number) {
        Kept& kept = kept_.at(number % kept_.size());
        std::uint64_t changes = 0;
        {
            const std::lock_guard lock(kept.mutex);
            if (kept.block != nullptr && kept.number == number) {
                return kept.block;
            }
            changes = kept.changes;
        }
        std::optional<CachedBlock> found = stored_now(number);
        if (!found) {
            return nullptr;
        }
        auto block = std::make_shared<const CachedBlock>(std::move(*found));
        const std::lock_guard lock(kept.mutex);
        if (kept.changes == changes) {  // else the block may be outdated
            kept.number = number;
            kept.block = block;
        }
        return block;
    }
    void let_go(std::uint64_t number) {
        Kept& kept = kept_.at(number % kept_.size());
        const std::lock_guard lock(kept.mutex);
        ++kept.changes;
        if (kept.number == number) {
            kept.block = nullptr;
        }
    }

    struct Kept {
        std::mutex mutex;
        std::uint64_t number = 0;
        BlockPointer block;
        std::uint64_t changes = 0;  ///< number of changes of its blocks' files
    };
    std::shared_ptr<CacheFolder> folder_;
    std::string name_;
    std::uint64_t name_checksum_;
    std::uint64_t size_;
    std::array<std::mutex, 16> adding_;  ///< by the block's number
    std::array<Kept, 8> kept_;           ///< likewise; 512 KiB
};

/// The name under which the state of an object is kept.
std::string name_of_state(const ObjectState& object) {
    return fmt::format("state of\n{}{}{}", object.url, object.query.empty() ? "" : "\n",
                       object.query);
}

/// The number of the state's entry.
std::uint64_t number_of_state(const std::string& name) {
    return checksum_of(std::as_bytes(std::span(name)));
}

/// Precedes the version in the bytes of the block.
struct StateHead {
    std::uint64_t size = 0;  ///< of the object
    std::uint64_t version_bytes = 0;
};

}  // namespace

std::optional<ObjectState> DiskCache::last_of(const ObjectState& object) const {
    const std::string name = name_of_state(object);
    const auto file = folder_->read(number_of_state(name), CachedBlock::kMaxFileBytes);
    const auto block = file ? CachedBlock::decode(*file, name, 0) : std::nullopt;
    StateHead head;
    if (!block || !block->copy(0, std::as_writable_bytes(std::span(&head, 1))) ||
        head.version_bytes > CachedBlock::kBytes - sizeof(head)) {
        return std::nullopt;
    }
    ObjectState state{object.url, std::string(head.version_bytes, ' '), head.size, object.query};
    return block->copy(sizeof(head), std::as_writable_bytes(std::span(state.version)))
               ? std::optional(std::move(state))
               : std::nullopt;
}

void DiskCache::remember(const ObjectState& object) const {
    const StateHead head{object.size, object.version.size()};
    if (object.version.size() > CachedBlock::kBytes - sizeof(head)) {
        return;
    }
    CachedBlock block;
    block.add(0, std::as_bytes(std::span(&head, 1)));
    block.add(sizeof(head), std::as_bytes(std::span(object.version)));
    const std::string name = name_of_state(object);
    const std::vector<std::byte> file = block.encode(name, 0);
    if (!file.empty()) {
        folder_->write(number_of_state(name), file);
    }
}

DiskCache::DiskCache(const std::filesystem::path& folder, std::uint64_t max_bytes)
    : folder_(std::make_shared<CacheFolder>(folder, max_bytes)) {}

std::unique_ptr<RangeCache> DiskCache::of(const ObjectState& object) const {
    return object.version.empty() ? nullptr : std::make_unique<CachedObject>(folder_, object);
}

std::string DiskCache::warning() const {
    return folder_->warning();
}

}  // namespace isonest::detail
