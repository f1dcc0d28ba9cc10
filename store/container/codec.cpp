#include "store/container/codec.h"

#include <fmt/format.h>
#define ZSTD_STATIC_LINKING_ONLY  // for the estimates of heap
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <memory>
#include <utility>

#include <isonest/error.h>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

static_assert(std::endian::native == std::endian::little);

struct FreeContext {
    void operator()(ZSTD_CCtx* c) const { ZSTD_freeCCtx(c); }
    void operator()(ZSTD_DCtx* c) const { ZSTD_freeDCtx(c); }
};

struct Packing {
    std::unique_ptr<ZSTD_CCtx, FreeContext> context{ZSTD_createCCtx()};
    std::vector<std::byte> shuffled;
    std::vector<std::byte> packed;
    std::vector<std::byte> sample;
};

struct Unpacking {
    std::unique_ptr<ZSTD_DCtx, FreeContext> context{ZSTD_createDCtx()};
    std::vector<std::byte> shuffled;
};

/// One state per thread, because creating a context is expensive.
template <class State>
State& thread_state() {
    thread_local State state;
    return state;
}

/// One pass per byte of the elements: narrowing stores, which compilers vectorise.
template <class Word>
[[gnu::always_inline]] inline void shuffle_words(const std::byte* from, std::byte* to,
                                                 std::size_t count) {
    constexpr std::size_t kBlock = 4096;  // stays in the L1 cache while it is read again
    for (std::size_t start = 0; start < count; start += kBlock) {
        const std::size_t n = std::min(kBlock, count - start);
        const Word* const words = reinterpret_cast<const Word*>(from) + start;
        for (std::size_t b = 0; b < sizeof(Word); ++b) {
            auto* const out = reinterpret_cast<std::uint8_t*>(to) + b * count + start;
            for (std::size_t i = 0; i < n; ++i) {
                out[i] = static_cast<std::uint8_t>(words[i] >> (8 * b));
            }
        }
    }
}

ISONEST_SIMD void shuffle2(const std::byte* from, std::byte* to, std::size_t count) {
    shuffle_words<std::uint16_t>(from, to, count);
}
ISONEST_SIMD void shuffle4(const std::byte* from, std::byte* to, std::size_t count) {
    shuffle_words<std::uint32_t>(from, to, count);
}
ISONEST_SIMD void shuffle8(const std::byte* from, std::byte* to, std::size_t count) {
    shuffle_words<std::uint64_t>(from, to, count);
}

/// A single expression, because a loop over the bytes of a word is not vectorised.
template <class Word, std::size_t... Byte>
[[gnu::always_inline]] inline void unshuffle_words(const std::byte* from, std::byte* to,
                                                   std::size_t count,
                                                   std::index_sequence<Byte...> /*bytes*/) {
    const auto* const bytes = reinterpret_cast<const std::uint8_t*>(from);
    Word* const words = reinterpret_cast<Word*>(to);
    for (std::size_t i = 0; i < count; ++i) {
        words[i] = static_cast<Word>(
            (static_cast<Word>(static_cast<Word>(bytes[Byte * count + i]) << (8 * Byte)) | ...));
    }
}

template <class Word>
[[gnu::always_inline]] inline void unshuffle_words(const std::byte* from, std::byte* to,
                                                   std::size_t count) {
    unshuffle_words<Word>(from, to, count, std::make_index_sequence<sizeof(Word)>());
}

ISONEST_SIMD void unshuffle2(const std::byte* from, std::byte* to, std::size_t count) {
    unshuffle_words<std::uint16_t>(from, to, count);
}
ISONEST_SIMD void unshuffle4(const std::byte* from, std::byte* to, std::size_t count) {
    unshuffle_words<std::uint32_t>(from, to, count);
}
ISONEST_SIMD void unshuffle8(const std::byte* from, std::byte* to, std::size_t count) {
    unshuffle_words<std::uint64_t>(from, to, count);
}

void shuffle(std::span<const std::byte> from, std::byte* to, std::size_t size) {
    const std::size_t count = from.size() / size;
    switch (size) {
        case 2:
            return shuffle2(from.data(), to, count);
        case 4:
            return shuffle4(from.data(), to, count);
        default:
            return shuffle8(from.data(), to, count);
    }
}

}  // namespace

void unshuffle(std::span<const std::byte> from, std::byte* to, std::size_t size) {
    const std::size_t count = from.size() / size;
    switch (size) {
        case 2:
            return unshuffle2(from.data(), to, count);
        case 4:
            return unshuffle4(from.data(), to, count);
        default:
            return unshuffle8(from.data(), to, count);
    }
}

namespace {

/// Leaves the compressed bytes at the start of `state.packed`, and returns their number.
std::size_t pack(std::span<const std::byte> raw, const CodecSpec& spec, Packing& state) {
    if (!state.context) {
        throw std::bad_alloc();
    }
    const std::byte* from = raw.data();
    if (spec.shuffle) {
        state.shuffled.resize(std::max(state.shuffled.size(), raw.size()));
        shuffle(raw, state.shuffled.data(), spec.element_size);
        from = state.shuffled.data();
    }
    ZSTD_CCtx* const context = state.context.get();
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, spec.level);
    ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 1);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
    state.packed.resize(std::max(state.packed.size(), ZSTD_compressBound(raw.size())));
    const std::size_t size =
        ZSTD_compress2(context, state.packed.data(), state.packed.size(), from, raw.size());
    if (ZSTD_isError(size) != 0U) {
        throw Error(ErrorKind::limit,
                    fmt::format("zstd could not compress a chunk: {}", ZSTD_getErrorName(size)));
    }
    return size;
}

/// Smaller chunks are always shuffled.
constexpr std::size_t kLeastChosen = 1024;

/// Compares on a few parts of the chunk, because compressing all of it twice takes too long.
bool is_shorter_unshuffled(std::span<const std::byte> raw, const CodecSpec& spec, Packing& state) {
    std::span<const std::byte> sample = raw;
    if (raw.size() > kSampledParts * kSampledPart) {
        state.sample.resize(kSampledParts * kSampledPart);
        for (std::size_t i = 0; i < kSampledParts; ++i) {
            const std::size_t element =
                (raw.size() - kSampledPart) / spec.element_size * i / (kSampledParts - 1);
            std::memcpy(state.sample.data() + i * kSampledPart,
                        raw.data() + element * spec.element_size, kSampledPart);
        }
        sample = state.sample;
    }
    const std::size_t shuffled = pack(sample, spec, state);
    CodecSpec plain = spec;
    plain.shuffle = false;
    // Less is not worth a store that older readers refuse.
    constexpr std::size_t kGain = 8;
    constexpr std::size_t kLeastGain = 64;
    return pack(sample, plain, state) + kLeastGain < shuffled - shuffled / kGain;
}

}  // namespace

void encode_chunk(std::span<const std::byte> raw, const CodecSpec& spec,
                  std::vector<std::byte>& out) {
    auto& state = thread_state<Packing>();
    const std::size_t size = pack(raw, spec, state);
    out.assign(state.packed.begin(), state.packed.begin() + static_cast<std::ptrdiff_t>(size));
}

bool encode_shorter(std::span<const std::byte> raw, const CodecSpec& spec,
                    std::vector<std::byte>& out) {
    CodecSpec chosen = spec;
    chosen.shuffle = spec.shuffle && (raw.size() < kLeastChosen ||
                                      !is_shorter_unshuffled(raw, spec, thread_state<Packing>()));
    encode_chunk(raw, chosen, out);
    return spec.shuffle && !chosen.shuffle;
}

void decode_chunk(std::span<const std::byte> stored, const CodecSpec& spec,
                  std::span<std::byte> raw, const ErrorPlace& place) {
    auto& state = thread_state<Unpacking>();
    if (!state.context) {
        throw std::bad_alloc();
    }
    const unsigned long long content = ZSTD_getFrameContentSize(stored.data(), stored.size());
    if (content != raw.size()) {
        throw Error(ErrorKind::corrupt, place,
                    fmt::format("the stored frame does not hold the chunk's {} bytes", raw.size()),
                    {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    }
    std::byte* to = raw.data();
    if (spec.shuffle) {
        state.shuffled.resize(std::max(state.shuffled.size(), raw.size()));
        to = state.shuffled.data();
    }
    const std::size_t size =
        ZSTD_decompressDCtx(state.context.get(), to, raw.size(), stored.data(), stored.size());
    if (ZSTD_isError(size) != 0U || size != raw.size()) {
        throw Error(ErrorKind::corrupt, place,
                    ZSTD_isError(size) != 0U ? ZSTD_getErrorName(size) : "the frame is too short",
                    {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    }
    if (spec.shuffle) {
        unshuffle({state.shuffled.data(), raw.size()}, raw.data(), spec.element_size);
    }
}

bool decompress(std::span<const std::byte> packed, std::span<std::byte> raw) {
    auto& state = thread_state<Unpacking>();
    if (!state.context) {
        throw std::bad_alloc();
    }
    return ZSTD_decompressDCtx(state.context.get(), raw.data(), raw.size(), packed.data(),
                               packed.size()) == raw.size();
}

std::size_t codec_heap(std::size_t chunk_bytes, int level) {
    const std::size_t shuffled = chunk_bytes;
    const std::size_t packed = chunk_bytes;
    const ZSTD_compressionParameters parameters = ZSTD_getCParams(level, chunk_bytes, 0);
    return shuffled + packed + kSampledParts * kSampledPart +
           ZSTD_estimateCCtxSize_usingCParams(parameters) + ZSTD_estimateDCtxSize();
}

std::size_t decode_heap(std::size_t chunk_bytes) {
    const std::size_t shuffled = chunk_bytes;
    constexpr std::size_t kUnusedCompressor = 16384;  // a ZSTD_CCtx that has compressed nothing
    return shuffled + ZSTD_estimateDCtxSize() + kUnusedCompressor;
}

}  // namespace isonest::detail
