// An image that lies in a file in several pieces, as one.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "preprocess/sources/bytes/byte_reader.h"

namespace isonest::detail {

/// A box of samples (points or cells), in the image's own indices from 0 on: x, y, z.
struct PieceBox {
    std::array<std::int64_t, 3> low{};
    std::array<std::int64_t, 3> count{};  ///< > 0
};

/// Whether every sample of the image is in one of the boxes, or in several. False also for boxes
/// that cut it into more than 100,000 parts.
bool cover(const std::vector<PieceBox>& boxes, const std::array<std::int64_t, 3>& image);

/// Whether all samples of a box are in one that comes later: then nothing of it counts.
bool is_within_later(const std::vector<PieceBox>& boxes, std::size_t index);

struct PieceNumbers {
    PieceBox box;
    std::unique_ptr<ByteReader> numbers;  ///< of its samples, x fastest
};

/// The bytes of the image, x fastest. Of samples in several pieces those of the last one count.
/// `sample_bytes`: of one sample with all its components. REQUIRES: cover().
std::unique_ptr<ByteReader> join_pieces(std::vector<PieceNumbers> pieces,
                                        const std::array<std::int64_t, 3>& image,
                                        std::uint64_t sample_bytes);

}  // namespace isonest::detail
