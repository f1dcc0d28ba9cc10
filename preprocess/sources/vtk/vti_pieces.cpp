#include "preprocess/sources/vtk/vti_pieces.h"

#include <algorithm>
#include <utility>

namespace isonest::detail {
namespace {

/// Samples from `low` up to `high`, which is no part of it.
struct Box {
    std::array<std::int64_t, 3> low{};
    std::array<std::int64_t, 3> high{};
};

Box box_of(const PieceBox& piece) {
    Box box{piece.low, piece.low};
    for (std::size_t i = 0; i < 3; ++i) {
        box.high.at(i) += piece.count.at(i);
    }
    return box;
}

/// What of `box` is not in `taken`, as up to six boxes.
void subtract(Box box, const Box& taken, std::vector<Box>& rest) {
    for (std::size_t i = 0; i < 3; ++i) {
        if (taken.high.at(i) <= box.low.at(i) || taken.low.at(i) >= box.high.at(i)) {
            rest.push_back(box);  // they do not meet
            return;
        }
    }
    for (std::size_t i = 0; i < 3; ++i) {
        if (box.low.at(i) < taken.low.at(i)) {
            rest.push_back(box);
            rest.back().high.at(i) = box.low.at(i) = taken.low.at(i);
        }
        if (box.high.at(i) > taken.high.at(i)) {
            rest.push_back(box);
            rest.back().low.at(i) = box.high.at(i) = taken.high.at(i);
        }
    }
}

bool contains(const Box& outer, const Box& inner) {
    for (std::size_t i = 0; i < 3; ++i) {
        if (inner.low.at(i) < outer.low.at(i) || inner.high.at(i) > outer.high.at(i)) {
            return false;
        }
    }
    return true;
}

std::uint64_t volume_of(const std::array<std::int64_t, 3>& count) {
    return static_cast<std::uint64_t>(count[0]) * static_cast<std::uint64_t>(count[1]) *
           static_cast<std::uint64_t>(count[2]);
}

class JoinedPieces : public ByteReader {
  public:
    JoinedPieces(std::vector<PieceNumbers> pieces, const std::array<std::int64_t, 3>& image,
                 std::uint64_t sample_bytes)
        : pieces_(std::move(pieces)), image_(image), sample_(sample_bytes) {}
    [[nodiscard]] std::uint64_t size() const override { return volume_of(image_) * sample_; }
    [[nodiscard]] bool sequential() const override {
        return std::any_of(pieces_.begin(), pieces_.end(),
                           [](const PieceNumbers& p) { return p.numbers->sequential(); });
    }
    [[nodiscard]] std::uint64_t heap() const override {
        std::uint64_t all = 0;
        for (const PieceNumbers& piece : pieces_) {
            all += piece.numbers->heap();
        }
        return all;
    }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        const std::uint64_t row = static_cast<std::uint64_t>(image_[0]) * sample_;
        while (bytes > 0) {
            const std::uint64_t n = std::min(bytes, row - at % row);
            read_row(static_cast<std::int64_t>(at / row), at % row, dst, n);
            at += n;
            dst += n;
            bytes -= n;
        }
    }

  private:
    /// Bytes [from, from + bytes) of a row.
    void read_row(std::int64_t row, std::uint64_t from, std::byte* dst, std::uint64_t bytes) {
        const std::int64_t y = row % image_[1];
        const std::int64_t z = row / image_[1];
        for (PieceNumbers& piece : pieces_) {
            const PieceBox& box = piece.box;
            const std::int64_t in_y = y - box.low[1];
            const std::int64_t in_z = z - box.low[2];
            const std::uint64_t begin = static_cast<std::uint64_t>(box.low[0]) * sample_;
            const std::uint64_t length = static_cast<std::uint64_t>(box.count[0]) * sample_;
            const std::uint64_t lo = std::max(begin, from);
            const std::uint64_t hi = std::min(begin + length, from + bytes);
            if (in_y < 0 || in_y >= box.count[1] || in_z < 0 || in_z >= box.count[2] || lo >= hi) {
                continue;
            }
            const auto rows = static_cast<std::uint64_t>(in_z * box.count[1] + in_y);
            piece.numbers->read(rows * length + lo - begin, dst + (lo - from), hi - lo);
        }
    }

    std::vector<PieceNumbers> pieces_;
    std::array<std::int64_t, 3> image_;
    std::uint64_t sample_;
};

}  // namespace

bool cover(const std::vector<PieceBox>& boxes, const std::array<std::int64_t, 3>& image) {
    constexpr std::size_t kMostParts = 100000;
    std::vector<Box> open{{{}, image}};
    for (const PieceBox& box : boxes) {
        std::vector<Box> rest;
        for (const Box& part : open) {
            subtract(part, box_of(box), rest);
        }
        open = std::move(rest);
        if (open.size() > kMostParts) {
            return false;
        }
    }
    return open.empty();
}

bool is_within_later(const std::vector<PieceBox>& boxes, std::size_t index) {
    return std::any_of(
        boxes.begin() + static_cast<std::ptrdiff_t>(index) + 1, boxes.end(),
        [&](const PieceBox& later) { return contains(box_of(later), box_of(boxes[index])); });
}

std::unique_ptr<ByteReader> join_pieces(std::vector<PieceNumbers> pieces,
                                        const std::array<std::int64_t, 3>& image,
                                        std::uint64_t sample_bytes) {
    return std::make_unique<JoinedPieces>(std::move(pieces), image, sample_bytes);
}

}  // namespace isonest::detail
