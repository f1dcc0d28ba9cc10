// Runs of bytes of arrays, packed into messages that say where each piece belongs.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "store/container/codec.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What a message has before it is compressed. While messages travel, no block is computed and no
/// window is held, and what a rank has of messages at a time (two on their way, one that is made,
/// one that is taken) is less than the window's share.
inline constexpr std::uint64_t kMostMessageBytes = Communicator::kMostBytes / 4;

/// At the beginning of a message. Its pieces follow, and then their bytes, all of one array and
/// together compressed as a chunk is, unless that makes them no smaller.
struct MessageHead {
    std::uint32_t array = 0;
    std::uint32_t pieces = 0;
    std::uint32_t bytes = 0;  ///< of what follows, before it was compressed
    std::uint32_t is_compressed = 0;
};
struct PieceHeader {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
};

/// How numbers of `element` bytes travel.
inline CodecSpec message_codec(std::size_t element) {
    return {element, element > 1, 1};
}

/// Packs what `Runs` gives: bool next(Run&), with members array, offset and bytes; and
/// std::size_t element(array), the bytes of an array's numbers: 1, 2, 4 or 8. Runs are of whole
/// numbers.
template <class Runs>
class RunMessages {
  public:
    explicit RunMessages(Runs runs) : runs_(std::move(runs)) {}

    /// The next message; false if there is none any more. bytes_at(array, offset) is where a
    /// piece's bytes are.
    template <class BytesAt>
    bool next(std::vector<std::byte>& message, const BytesAt& bytes_at) {
        pieces_.clear();
        MessageHead head;
        each_piece([&](std::size_t array, const PieceHeader& piece) {
            head.array = static_cast<std::uint32_t>(array);
            pieces_.push_back(piece);
        });
        message.clear();
        if (pieces_.empty()) {
            return false;
        }
        const auto heads = std::as_bytes(std::span(pieces_));
        body_.assign(heads.begin(), heads.end());
        for (const PieceHeader& piece : pieces_) {
            const std::byte* const from = bytes_at(head.array, piece.offset);
            body_.insert(body_.end(), from, from + piece.bytes);
        }
        head.pieces = static_cast<std::uint32_t>(pieces_.size());
        head.bytes = static_cast<std::uint32_t>(body_.size());
        encode_chunk(body_, message_codec(runs_.element(head.array)), compressed_);
        head.is_compressed = compressed_.size() < body_.size() ? 1 : 0;
        const std::vector<std::byte>& sent = head.is_compressed != 0 ? compressed_ : body_;
        const auto* const bytes = reinterpret_cast<const std::byte*>(&head);
        message.assign(bytes, bytes + sizeof(head));
        message.insert(message.end(), sent.begin(), sent.end());
        return true;
    }
    /// How many messages there are from here on.
    std::uint64_t count() {
        std::uint64_t messages = 0;
        for (bool any = true; any;) {
            any = false;
            each_piece([&](std::size_t /*array*/, const PieceHeader& /*piece*/) { any = true; });
            messages += any ? 1 : 0;
        }
        return messages;
    }

  private:
    /// f(array, piece) for those of one message.
    template <class F>
    void each_piece(const F& f) {
        constexpr std::uint64_t kWhole = ~std::uint64_t{7};  // no number is cut
        std::uint64_t room = kMostMessageBytes - sizeof(MessageHead);
        bool is_first = true;
        std::size_t array = 0;
        while (room >= sizeof(PieceHeader) + sizeof(std::uint64_t)) {
            if (left_.bytes == 0 && !runs_.next(left_)) {
                return;
            }
            array = std::exchange(is_first, false) ? left_.array : array;
            if (left_.array != array) {
                return;
            }
            const std::uint64_t bytes =
                std::min(left_.bytes, (room - sizeof(PieceHeader)) & kWhole);
            f(array, PieceHeader{left_.offset, bytes});
            left_.offset += bytes;
            left_.bytes -= bytes;
            room -= bytes + sizeof(PieceHeader);
        }
    }

    Runs runs_;
    typename Runs::Run left_;
    std::vector<PieceHeader> pieces_;
    std::vector<std::byte> body_;
    std::vector<std::byte> compressed_;
};

/// f(array, offset, bytes) for the pieces of a message. element(array): as above. Throws
/// std::logic_error.
template <class Element, class F>
void unpack_runs(std::span<const std::byte> message, const Element& element, const F& f) {
    MessageHead head;
    std::memcpy(&head, message.data(), sizeof(head));
    std::span<const std::byte> body = message.subspan(sizeof(head));
    std::vector<std::byte> plain;
    if (head.is_compressed != 0) {
        plain.resize(head.bytes);
        decode_chunk(body, message_codec(element(head.array)), plain, {"", "a message"});
        body = plain;
    }
    std::span<const std::byte> from = body.subspan(head.pieces * sizeof(PieceHeader));
    for (std::uint32_t i = 0; i < head.pieces; ++i) {
        PieceHeader piece;
        std::memcpy(&piece, body.data() + i * sizeof(piece), sizeof(piece));
        f(head.array, piece.offset, from.first(piece.bytes));
        from = from.subspan(piece.bytes);
    }
    if (!from.empty()) {
        throw std::logic_error("a message with more than its pieces");
    }
}

}  // namespace isonest::detail
