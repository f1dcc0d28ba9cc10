// Blocks on their way between ranks: bytes of any length, in messages of at most
// Communicator::kMostBytes, each of which has bytes of one block.
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

#include "query/ranks/packed_patch.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Not thread-safe.
class BlockSender {
  public:
    /// `packed`: begins with its own length (packed_patch.h).
    void add(int to, std::vector<std::byte> packed) { blocks_.push_back({to, std::move(packed)}); }
    /// How many messages `to` gets of those that were added and not yet sent.
    [[nodiscard]] std::uint64_t messages(int to) const {
        std::uint64_t count = 0;
        for (const Block& block : blocks_) {
            count += block.to == to ? (block.packed.size() + kMost - 1) / kMost : 0;
        }
        return count;
    }
    /// As Communicator::Next: in the order in which they were added.
    bool next(Communicator::Message& message) {
        if (blocks_.empty()) {
            return false;
        }
        Block& block = blocks_.front();
        message.to = block.to;
        if (at_ == 0 && block.packed.size() <= kMost) {
            message.bytes = std::move(block.packed);
            blocks_.pop_front();
            return true;
        }
        const std::span<const std::byte> rest = std::span(block.packed).subspan(at_);
        const auto part = rest.first(std::min(rest.size(), kMost));
        message.bytes.assign(part.begin(), part.end());
        at_ += part.size();
        if (at_ == block.packed.size()) {
            blocks_.pop_front();
            at_ = 0;
        }
        return true;
    }

  private:
    static constexpr std::size_t kMost = Communicator::kMostBytes;
    struct Block {
        int to = 0;
        std::vector<std::byte> packed;
    };
    std::deque<Block> blocks_;
    std::size_t at_ = 0;  ///< of the first one, what was sent of it
};

/// From one rank. Not thread-safe.
class BlockReceiver {
  public:
    /// A block, if it ends with this message.
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
