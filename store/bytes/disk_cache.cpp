#include "store/bytes/disk_cache.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "store/base/checksum.h"
#include "store/bytes/cache_folder.h"
#include "store/bytes/cached_block.h"

namespace isonest::detail {
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
                // Neighbours that come at the same time share a block at their border.
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
    /// Of a range, what lies in one block.
    struct Piece {
        std::uint64_t block = 0;
        std::size_t from = 0;  ///< in the block
        std::size_t at = 0;    ///< in the range
        std::size_t size = 0;
    };

    [[nodiscard]] bool is_inside(ByteRange range) const {
        return range.offset <= size_ && range.size <= size_ - range.offset;
    }

    /// f(piece) for those of the range, as long as it returns true. Returns whether it always did.
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

    /// Of the entry.
    [[nodiscard]] std::uint64_t number_of(std::uint64_t block) const {
        const std::array<std::uint64_t, 2> key{name_checksum_, block};
        return checksum_of(std::as_bytes(std::span(key)));
    }

    /// A block's file in the cache's folder.
    struct Entry {
        bool is_there = false;
        std::optional<CachedBlock> block;  ///< none where the file is damaged
    };
    [[nodiscard]] Entry entry(std::uint64_t block) const {
        const auto file = folder_->read(number_of(block), CachedBlock::kMostFileBytes);
        return file ? Entry{true, CachedBlock::decode(*file, name_, block)} : Entry{};
    }

    /// A damaged entry goes away. REQUIRES: its mutex of adding_ is held; else what goes away may
    /// be what has just been put in the place of the damaged one.
    [[nodiscard]] std::optional<CachedBlock> stored(std::uint64_t block) {
        Entry found = entry(block);
        if (found.is_there && !found.block) {
            folder_->remove(number_of(block));
        }
        return std::move(found.block);
    }
    /// The same, whoever adds to it meanwhile.
    [[nodiscard]] std::optional<CachedBlock> stored_now(std::uint64_t block) {
        Entry found = entry(block);
        if (!found.is_there || found.block) {
            return std::move(found.block);
        }
        const std::lock_guard lock(adding_.at(block % adding_.size()));
        return stored(block);
    }

    using BlockPointer = std::shared_ptr<const CachedBlock>;

    /// Ranges that lie beside each other are asked for one after the other: their block is read
    /// once.
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
        if (kept.changes == changes) {  // else it may be as it was before
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
        std::uint64_t changes = 0;  ///< of files of its blocks
    };
    std::shared_ptr<CacheFolder> folder_;
    std::string name_;
    std::uint64_t name_checksum_;
    std::uint64_t size_;
    std::array<std::mutex, 16> adding_;  ///< by the block's number
    std::array<Kept, 8> kept_;           ///< the same: 512 KiB
};

/// Under which the state of an object is kept.
std::string name_of_state(const ObjectState& object) {
    return fmt::format("state of\n{}{}{}", object.url, object.query.empty() ? "" : "\n",
                       object.query);
}

/// Of the entry.
std::uint64_t number_of_state(const std::string& name) {
    return checksum_of(std::as_bytes(std::span(name)));
}

/// In front of the version, in a block's bytes.
struct StateHead {
    std::uint64_t size = 0;  ///< of the object
    std::uint64_t version_bytes = 0;
};

}  // namespace

std::optional<ObjectState> DiskCache::last_of(const ObjectState& object) const {
    const std::string name = name_of_state(object);
    const auto file = folder_->read(number_of_state(name), CachedBlock::kMostFileBytes);
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

DiskCache::DiskCache(const std::filesystem::path& folder, std::uint64_t most_bytes)
    : folder_(std::make_shared<CacheFolder>(folder, most_bytes)) {}

std::unique_ptr<RangeCache> DiskCache::of(const ObjectState& object) const {
    return object.version.empty() ? nullptr : std::make_unique<CachedObject>(folder_, object);
}

std::string DiskCache::warning() const {
    return folder_->warning();
}

}  // namespace isonest::detail
