// Runs of bytes of arrays, packed into messages that say where each piece belongs.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// In front of each piece.
struct PieceHeader {
    std::uint32_t array = 0;
    std::uint32_t bytes = 0;
    std::uint64_t offset = 0;
};

/// Packs what `Runs` gives: bool next(Run&), with members array, offset and bytes.
template <class Runs>
class RunMessages {
  public:
    explicit RunMessages(Runs runs) : runs_(std::move(runs)) {}

    /// The next message; false if there is none any more. bytes_at(array, offset) is where a
    /// piece's bytes are.
    template <class BytesAt>
    bool next(std::vector<std::byte>& message, const BytesAt& bytes_at) {
        message.clear();
        each_piece([&](const PieceHeader& piece) {
            const auto* const header = reinterpret_cast<const std::byte*>(&piece);
            const std::byte* const from = bytes_at(piece.array, piece.offset);
            message.insert(message.end(), header, header + sizeof(piece));
            message.insert(message.end(), from, from + piece.bytes);
        });
        return !message.empty();
    }
    /// How many messages there are from here on.
    std::uint64_t count() {
        std::uint64_t messages = 0;
        for (bool any = true; any;) {
            any = false;
            each_piece([&](const PieceHeader& /*piece*/) { any = true; });
            messages += any ? 1 : 0;
        }
        return messages;
    }

  private:
    /// f(piece) for those of one message.
    template <class F>
    void each_piece(const F& f) {
        std::uint64_t room = Communicator::kMostBytes;
        while (room > sizeof(PieceHeader)) {
            if (left_.bytes == 0 && !runs_.next(left_)) {
                return;
            }
            const std::uint64_t bytes = std::min(left_.bytes, room - sizeof(PieceHeader));
            f(PieceHeader{static_cast<std::uint32_t>(left_.array),
                          static_cast<std::uint32_t>(bytes), left_.offset});
            left_.offset += bytes;
            left_.bytes -= bytes;
            room -= bytes + sizeof(PieceHeader);
        }
    }

    Runs runs_;
    typename Runs::Run left_;
};

/// f(piece, its bytes) for those of a message.
template <class F>
void unpack_runs(std::span<const std::byte> message, const F& f) {
    while (!message.empty()) {
        PieceHeader piece;
        std::memcpy(&piece, message.data(), sizeof(piece));
        f(piece, message.subspan(sizeof(piece), piece.bytes));
        message = message.subspan(sizeof(piece) + piece.bytes);
    }
}

}  // namespace isonest::detail
