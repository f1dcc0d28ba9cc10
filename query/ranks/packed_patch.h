// Patches as bytes, for messages between ranks.
//
// Numbers are stored as in memory: all ranks run the same program. A patch takes about 13 bytes for
// each triangle of the full surface, and 41 for one that was simplified before.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "query/simplify/collapse/map_mesh.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Size of the length, a std::uint64_t, in front of packed data; included in the length.
inline constexpr std::size_t kPackedHead = 8;

/// Maximum bytes per triangle of a patch, if no two share a vertex, and per triangle of the result,
/// not including a few bytes per block and those of gone_at.
inline constexpr std::size_t kMaxPackedPatch = 89;
inline constexpr std::size_t kMaxPackedResult = 41;

/// Packs all data of a patch, bit for bit. These functions are thread-safe.
std::vector<std::byte> packed_patch(const MappedPatch& patch);
/// Throws std::logic_error if the bytes are not those of a packed patch.
MappedPatch unpacked_patch(std::span<const std::byte> bytes);

/// The changes made by map_patch(): triangles, displacements and tried, and its return value.
std::vector<std::byte> packed_result(const MappedPatch& patch, const GoneTriangles& gone_at);
/// Applies packed changes to a block, except to its vertices.
void unpack_result(std::span<const std::byte> bytes, MappedBlock& block);

// Transfer of blocks between ranks: bytes of any length, in messages of at most
// Communicator::kMaxBytes, each with bytes of one block.

/// Not thread-safe.
class BlockSender {
  public:
    /// `packed`: starts with its own length.
    void add(int to, std::vector<std::byte> packed) { blocks_.push_back({to, std::move(packed)}); }
    /// Number of messages to `to` for blocks that were added and not yet sent.
    [[nodiscard]] std::uint64_t messages(int to) const {
        std::uint64_t count = 0;
        for (const Block& block : blocks_) {
            count += block.to == to ? (block.packed.size() + kMax - 1) / kMax : 0;
        }
        return count;
    }
    /// As Communicator::Next; in the order in which blocks were added.
    bool next(Communicator::Message& message) {
        if (blocks_.empty()) {
            return false;
        }
        Block& block = blocks_.front();
        message.to = block.to;
        if (at_ == 0 && block.packed.size() <= kMax) {
            message.bytes = std::move(block.packed);
            blocks_.pop_front();
            return true;
        }
        const std::span<const std::byte> rest = std::span(block.packed).subspan(at_);
        const auto part = rest.first(std::min(rest.size(), kMax));
        message.bytes.assign(part.begin(), part.end());
        at_ += part.size();
        if (at_ == block.packed.size()) {
            blocks_.pop_front();
            at_ = 0;
        }
        return true;
    }

  private:
    static constexpr std::size_t kMax = Communicator::kMaxBytes;
    struct Block {
        int to = 0;
        std::vector<std::byte> packed;
    };
    std::deque<Block> blocks_;
    std::size_t at_ = 0;  ///< how much of the first block was sent
};

/// Receives from one rank. Not thread-safe.
class BlockReceiver {
  public:
    /// Returns a block, if it ends with this message.
    std::optional<std::vector<std::byte>> take(std::span<const std::byte> message) {
        if (packed_.empty()) {
            std::memcpy(&size_, message.data(), sizeof(size_));
            packed_.reserve(size_);
        }
        packed_.insert(packed_.end(), message.begin(), message.end());
        return packed_.size() < size_ ? std::nullopt : std::optional(std::exchange(packed_, {}));
    }

  private:
    static_assert(sizeof(std::uint64_t) == kPackedHead);
    std::uint64_t size_ = 0;
    std::vector<std::byte> packed_;
};

}  // namespace isonest::detail
