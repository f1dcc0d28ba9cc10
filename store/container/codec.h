// The stored form of a chunk: HDF5's byte shuffle, then one zstd frame with content size and
// checksum.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/error.h>

#include "store/base/checksum.h"

namespace isonest::detail {

// Indicators in 16 bits, rounded up by a monotone rule, so that saturation and all bounds are
// preserved (method: section 5 of the paper needs eta(parent) >= eta(child), and a bound may only
// grow).

/// The upper half of an IEEE binary32 ("bfloat16"): 1 sign, 8 exponent and 7 fraction bits. The
/// last two fraction bits are 0: they would be incompressible noise.
using IndicatorCode = std::uint16_t;
inline constexpr int kCodeFractionBits = 5;
/// Difference between two successive codes; then the code of infinity.
inline constexpr IndicatorCode kCodeStep = 1U << (7 - kCodeFractionBits);
inline constexpr IndicatorCode kInfinityCode = 0x7F80;
/// Maximum relative excess of a code's value, for normal numbers.
inline constexpr double kCodeExcess = 1.0 / (1 << kCodeFractionBits);

/// The smallest binary32 that is >= value. REQUIRES: value >= 0 or +inf.
inline float round_up_to_float(double value) {
    const auto f = static_cast<float>(value);
    const std::uint32_t up = static_cast<double>(f) < value ? 1U : 0U;
    return std::bit_cast<float>(std::bit_cast<std::uint32_t>(f) + up);
}
inline float round_up_to_float(float value) {
    return value;
}

/// The smallest code whose value is >= value. REQUIRES: value >= 0 or +inf.
inline IndicatorCode encode_indicator(float value) {
    constexpr std::uint32_t kRest = (std::uint32_t{kCodeStep} << 16U) - 1;
    return static_cast<IndicatorCode>(((std::bit_cast<std::uint32_t>(value) + kRest) & ~kRest) >>
                                      16U);
}

/// The exact value of a code, or of an indicator stored as binary32.
constexpr float decode_indicator(IndicatorCode code) {
    return std::bit_cast<float>(static_cast<std::uint32_t>(code) << 16);
}
inline float decode_indicator(float value) {
    return value;
}

/// How the chunks of an array are stored.
struct CodecSpec {
    std::size_t element_size = 1;  ///< bytes of one element, the unit of the shuffle
    bool shuffle = false;          ///< HDF5 filter 2 before the compression
    int level = 1;                 ///< zstd level
};

/// Compresses `raw` into `out` (replaced). Thread-safe: each thread has its own contexts.
void encode_chunk(std::span<const std::byte> raw, const CodecSpec& spec,
                  std::vector<std::byte>& out);

/// The same, but without the shuffle if that makes the chunk notably shorter; returns whether it
/// left the shuffle out. Depends on `raw` and `spec` alone.
[[nodiscard]] bool encode_shorter(std::span<const std::byte> raw, const CodecSpec& spec,
                                  std::vector<std::byte>& out);

/// Decompresses one stored chunk into `raw`, which has exactly the size of the chunk. `place`: of
/// the chunk, for the error. Throws Error{corrupt}. Thread-safe.
void decode_chunk(std::span<const std::byte> stored, const CodecSpec& spec,
                  std::span<std::byte> raw, const ErrorPlace& place);

/// Decompresses `packed` into `raw`. Returns whether its zstd frames fill `raw`. Thread-safe.
[[nodiscard]] bool decompress(std::span<const std::byte> packed, std::span<std::byte> raw);
/// Reverts HDF5's shuffle of elements of `size` bytes (2, 4 or 8). REQUIRES: from.size() is a
/// multiple of `size`, and `to` has as many bytes.
void unshuffle(std::span<const std::byte> from, std::byte* to, std::size_t size);

/// Parts of a chunk that are compressed both ways, to choose one; and bytes of a part, a multiple
/// of the sizes of elements.
inline constexpr std::size_t kSampledParts = 4;
inline constexpr std::size_t kSampledPart = 8192;

/// Maximum heap of one thread's contexts and buffers for chunks of `chunk_bytes`.
std::size_t codec_heap(std::size_t chunk_bytes, int level);
/// The same for a thread that only decodes.
std::size_t decode_heap(std::size_t chunk_bytes);

}  // namespace isonest::detail
