#include "store/codec.h"

#include <fmt/format.h>
#include <xxhash.h>
#include <zstd.h>

#include <cstdint>
#include <memory>

#include "store/error.h"

namespace isonest {
namespace {

struct FreeContext {
    void operator()(ZSTD_CCtx* c) const { ZSTD_freeCCtx(c); }
    void operator()(ZSTD_DCtx* c) const { ZSTD_freeDCtx(c); }
};

struct ThreadState {
    std::unique_ptr<ZSTD_CCtx, FreeContext> compress{ZSTD_createCCtx()};
    std::unique_ptr<ZSTD_DCtx, FreeContext> decompress{ZSTD_createDCtx()};
    std::vector<std::byte> shuffled;
};

ThreadState& thread_state() {
    thread_local ThreadState state;
    return state;
}

template <std::size_t Size>
void shuffle_fixed(const std::byte* from, std::byte* to, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t b = 0; b < Size; ++b) {
            to[b * count + i] = from[i * Size + b];
        }
    }
}

template <std::size_t Size>
void unshuffle_fixed(const std::byte* from, std::byte* to, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t b = 0; b < Size; ++b) {
            to[i * Size + b] = from[b * count + i];
        }
    }
}

void shuffle(std::span<const std::byte> from, std::byte* to, std::size_t size) {
    const std::size_t count = from.size() / size;
    switch (size) {
        case 2:
            return shuffle_fixed<2>(from.data(), to, count);
        case 4:
            return shuffle_fixed<4>(from.data(), to, count);
        default:
            return shuffle_fixed<8>(from.data(), to, count);
    }
}

void unshuffle(std::span<const std::byte> from, std::byte* to, std::size_t size) {
    const std::size_t count = from.size() / size;
    switch (size) {
        case 2:
            return unshuffle_fixed<2>(from.data(), to, count);
        case 4:
            return unshuffle_fixed<4>(from.data(), to, count);
        default:
            return unshuffle_fixed<8>(from.data(), to, count);
    }
}

}  // namespace

void encode_chunk(std::span<const std::byte> raw, const CodecSpec& spec,
                  std::vector<std::byte>& out) {
    ThreadState& state = thread_state();
    if (!state.compress) {
        throw std::bad_alloc();
    }
    const std::byte* from = raw.data();
    if (spec.shuffle) {
        state.shuffled.resize(raw.size());
        shuffle(raw, state.shuffled.data(), spec.element_size);
        from = state.shuffled.data();
    }
    ZSTD_CCtx* const context = state.compress.get();
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, spec.level);
    ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 1);
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
    out.resize(ZSTD_compressBound(raw.size()));
    const std::size_t size = ZSTD_compress2(context, out.data(), out.size(), from, raw.size());
    if (ZSTD_isError(size) != 0U) {
        throw Error(ErrorKind::limit,
                    fmt::format("zstd could not compress a chunk: {}", ZSTD_getErrorName(size)));
    }
    out.resize(size);
}

void decode_chunk(std::span<const std::byte> stored, const CodecSpec& spec,
                  std::span<std::byte> raw, const std::string& place) {
    ThreadState& state = thread_state();
    if (!state.decompress) {
        throw std::bad_alloc();
    }
    const unsigned long long content = ZSTD_getFrameContentSize(stored.data(), stored.size());
    if (content != raw.size()) {
        throw Error(ErrorKind::corrupt,
                    fmt::format("{}: the stored frame does not hold the chunk's {} bytes; restore "
                                "the store from a good copy or preprocess again",
                                place, raw.size()));
    }
    std::byte* to = raw.data();
    if (spec.shuffle) {
        state.shuffled.resize(raw.size());
        to = state.shuffled.data();
    }
    const std::size_t size = ZSTD_decompressDCtx(state.decompress.get(), to, raw.size(),
                                                 stored.data(), stored.size());
    if (ZSTD_isError(size) != 0U || size != raw.size()) {
        throw Error(ErrorKind::corrupt,
                    fmt::format("{}: {}; restore the store from a good copy or preprocess again",
                                place,
                                ZSTD_isError(size) != 0U ? ZSTD_getErrorName(size)
                                                         : "the frame is too short"));
    }
    if (spec.shuffle) {
        unshuffle(state.shuffled, raw.data(), spec.element_size);
    }
}

std::uint64_t checksum_of(std::span<const std::byte> bytes) {
    return XXH64(bytes.data(), bytes.size(), 0);
}

std::size_t codec_heap(std::size_t chunk_bytes) {
    return 2 * chunk_bytes + (4U << 20U);
}

}  // namespace isonest
