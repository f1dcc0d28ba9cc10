// The size that a stream of JPEG, JPEG-LS or JPEG 2000 says it has: ISO/IEC 10918-1 B.2.2 (frame
// header), 14495-1 C.2.2 (SOF55), 15444-1 A.5.1 (SIZ).
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace isonest::detail {

struct CodestreamSize {
    std::int64_t columns = 0;
    std::int64_t rows = 0;
    int components = 0;
    int bits = 0;  ///< of a number
};

/// Whether it begins as a stream of JPEG 2000 without a file's boxes.
bool is_jpeg2000(std::span<const char> stream);
/// None where the stream is of none of these or ends before its size. No I/O.
std::optional<CodestreamSize> codestream_size(std::span<const char> stream);

}  // namespace isonest::detail
