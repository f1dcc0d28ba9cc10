// Source: the registered HDF5 filter plugins, https://github.com/HDFGroup/hdf5_plugins (ZSTD,
// 32015): cd_values[0] is the compression level, and the chunk is one zstd frame.
#include "store/hdf5/zstd_filter.h"

#include <zstd.h>

#include <memory>
#include <mutex>

namespace isonest::detail {
namespace {

constexpr H5Z_filter_t kId = 32015;
constexpr unsigned long long kLargest = 0xFFFFFFFFULL;  // HDF5 1.10 chunks are smaller than 4 GiB

/// True if a frame of `bytes` can contain `content`: a block takes at least 4 bytes, and contains
/// at most 128 KiB (RFC 8878, section 3.1.1.2). HDF5 does not tell a filter the expected size, so
/// this check keeps a damaged header from allocating gigabytes.
bool is_plausible(unsigned long long content, std::size_t bytes) {
    constexpr unsigned long long kMinBlock = 4;
    constexpr unsigned long long kLargestBlock = 128U << 10U;
    return content > 0 && content <= kLargest && content / kLargestBlock <= bytes / kMinBlock;
}

struct FreeHdf5 {
    void operator()(void* p) const { H5free_memory(p); }
};
using Buffer = std::unique_ptr<void, FreeHdf5>;

std::size_t decompress(std::size_t bytes, std::size_t* capacity, void** data) {
    const unsigned long long content = ZSTD_getFrameContentSize(*data, bytes);
    if (content == ZSTD_CONTENTSIZE_UNKNOWN || content == ZSTD_CONTENTSIZE_ERROR ||
        !is_plausible(content, bytes)) {
        return 0;
    }
    Buffer out(H5allocate_memory(content, false));
    if (out == nullptr) {
        return 0;
    }
    const std::size_t size = ZSTD_decompress(out.get(), content, *data, bytes);
    if (ZSTD_isError(size) != 0U || size != content) {
        return 0;
    }
    H5free_memory(*data);
    *data = out.release();
    *capacity = content;
    return size;
}

std::size_t compress(int level, std::size_t bytes, std::size_t* capacity, void** data) {
    const std::size_t bound = ZSTD_compressBound(bytes);
    Buffer out(H5allocate_memory(bound, false));
    const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                       &ZSTD_freeCCtx);
    if (out == nullptr || context == nullptr) {
        return 0;
    }
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_contentSizeFlag, 1);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
    const std::size_t size = ZSTD_compress2(context.get(), out.get(), bound, *data, bytes);
    if (ZSTD_isError(size) != 0U) {
        return 0;
    }
    H5free_memory(*data);
    *data = out.release();
    *capacity = bound;
    return size;
}

std::size_t filter(unsigned flags, std::size_t parameters, const unsigned* values,
                   std::size_t bytes, std::size_t* capacity, void** data) {
    if ((flags & H5Z_FLAG_REVERSE) != 0U) {
        return decompress(bytes, capacity, data);
    }
    return compress(parameters > 0 ? static_cast<int>(values[0]) : ZSTD_CLEVEL_DEFAULT, bytes,
                    capacity, data);
}

}  // namespace

const H5Z_class2_t& zstd_filter_class() {
    static const H5Z_class2_t description{H5Z_CLASS_T_VERS, kId,     1,       1,
                                          "Zstandard",      nullptr, nullptr, &filter};
    return description;
}

void register_zstd_filter() {
    static std::once_flag once;
    std::call_once(once, [] { H5Zregister(&zstd_filter_class()); });
}

}  // namespace isonest::detail
