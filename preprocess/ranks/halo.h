// What ranks need from each other for a pass: rows of nodes and cubes around their pencils.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/ranks/pencils.h"
#include "store/container/codec.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

// Runs of bytes of arrays, packed into messages that say where each piece belongs.

/// Maximum size of a message before compression. During an exchange no block is computed and no
/// window is held, so a rank's messages (two on their way, one being made, one being taken) take
/// less memory than the window's share.
inline constexpr std::uint64_t kMaxMessageBytes = Communicator::kMaxBytes / 4;

/// Start of a message. It is followed by its pieces, and then by their bytes, all of one array;
/// both are compressed together like a chunk, unless that does not make them smaller.
struct MessageHead {
    std::uint32_t array = 0;
    std::uint32_t pieces = 0;
    std::uint32_t bytes = 0;  ///< of what follows, before compression
    std::uint32_t is_compressed = 0;
};
struct PieceHeader {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
};

/// The codec for numbers of `element` bytes.
inline CodecSpec message_codec(std::size_t element) {
    return {element, element > 1, 1};
}

/// Packs the runs provided by `Runs`: bool next(Run&), with members array, offset and bytes; and
/// std::size_t element(array), the bytes of an array's numbers: 1, 2, 4 or 8. Runs consist of whole
/// numbers.
template <class Runs>
class RunMessages {
  public:
    explicit RunMessages(Runs runs) : runs_(std::move(runs)) {}

    /// Makes the next message; false if there are no more. bytes_at(array, offset) returns the
    /// bytes of a piece.
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
    /// Counts the remaining messages.
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
    /// Calls f(array, piece) for the pieces of one message.
    template <class F>
    void each_piece(const F& f) {
        constexpr std::uint64_t kWhole = ~std::uint64_t{7};  // numbers are not split
        std::uint64_t room = kMaxMessageBytes - sizeof(MessageHead);
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

/// Calls f(array, offset, bytes) for the pieces of a message. element(array): as above. Throws
/// std::logic_error.
template <class Element, class F>
void unpack_runs(std::span<const std::byte> message, const Element& element, const F& f) {
    MessageHead head;
    std::memcpy(&head, message.data(), sizeof(head));
    std::span<const std::byte> body = message.subspan(sizeof(head));
    std::vector<std::byte> plain;
    if (head.is_compressed != 0) {
        plain.resize(head.bytes);
        decode_chunk(body, message_codec(element(head.array)), plain,
                     {"", "a message from another rank"});
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
        throw std::logic_error("a message has bytes after its last piece");
    }
}

/// An array [z][y][x], of which every rank has the rows that its pencils made.
struct HaloArray {
    PencilCut made;         ///< the pencils that made the array
    std::int64_t rows = 1;  ///< rows, and also planes, that one pencil makes
    Int3 size;              ///< in elements
    std::uint64_t row_bytes = 0;
    std::size_t element = 1;     ///< bytes of a number: 1, 2, 4 or 8
    std::span<std::byte> bytes;  ///< of the whole array; only this rank's rows are present
    /// Reserves space for bytes at an offset.
    std::function<void(std::uint64_t offset, std::uint64_t bytes)> reserve;
    /// A pencil with cubes lo to hi - 1 needs rows and planes scale * lo - before to scale * hi +
    /// behind. REQUIRES: `before` and `behind` are less than `rows`.
    std::int64_t scale = 1;
    std::int64_t before = 0;
    std::int64_t behind = 0;
};

/// The rows of `arrays` that rank `from` has computed and rank `to` needs for its pencils of the
/// cut `needing`, as runs in an order that both ranks know.
class HaloRuns {
  public:
    struct Run {
        std::size_t array = 0;
        std::uint64_t offset = 0;
        std::uint64_t bytes = 0;
    };
    HaloRuns(const Pencils& pencils, const PencilCut& needing, std::span<const HaloArray> arrays,
             int from, int to);
    bool next(Run& run);
    [[nodiscard]] std::size_t element(std::size_t array) const { return arrays_[array].element; }

  private:
    bool load_pencil();

    const Pencils* pencils_;
    PencilCut needing_;
    std::span<const HaloArray> arrays_;
    int from_;
    int to_;
    std::size_t array_ = 0;
    std::vector<Pencil> made_;
    std::size_t pencil_ = 0;
    std::vector<Run> runs_;
    std::size_t run_ = 0;
};

/// Sends all ranks what their pencils of the cut `needing` need. Collective.
void exchange_halos(Communicator& ranks, const Pencils& pencils, const PencilCut& needing,
                    std::span<const HaloArray> arrays);

}  // namespace isonest::detail
