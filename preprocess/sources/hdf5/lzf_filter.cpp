// Source: h5py's filter, https://github.com/h5py/h5py/tree/master/lzf: cd_values[2], if present, is
// the size of a chunk in bytes. An incompressible chunk is stored unchanged, and its filter mask
// says so.
#include "preprocess/sources/hdf5/lzf_filter.h"

#if ISONEST_WITH_LZF
#include <lzf.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <mutex>
#endif

namespace isonest::detail {

#if ISONEST_WITH_LZF
namespace {

constexpr std::size_t kMaxBytes = 0xFFFFFFFF;  // HDF5 chunks are smaller than 4 GiB

struct FreeLzfBuffer {
    void operator()(void* p) const { H5free_memory(p); }
};

std::size_t lzf_filter(unsigned flags, std::size_t parameters, const unsigned* values,
                       std::size_t bytes, std::size_t* capacity, void** data) {
    if ((flags & H5Z_FLAG_REVERSE) == 0U || bytes == 0 || bytes > kMaxBytes) {
        return 0;
    }
    // Three bytes expand to 264 at most, so a damaged chunk cannot request more memory than that.
    const std::size_t most = std::min(bytes / 3 * 264 + 264, kMaxBytes);
    constexpr std::size_t kChunkBytes = 2;
    std::size_t size = parameters > kChunkBytes && values[kChunkBytes] > 0
                           ? std::size_t{values[kChunkBytes]}
                           : std::max(*capacity, bytes);
    // Other filters may have made the chunk longer, and older files do not contain its size.
    for (size = std::min(size, most);; size = std::min(2 * size, most)) {
        std::unique_ptr<void, FreeLzfBuffer> out(H5allocate_memory(size, false));
        if (out == nullptr) {
            return 0;
        }
        const unsigned made = ::lzf_decompress(*data, static_cast<unsigned>(bytes), out.get(),
                                               static_cast<unsigned>(size));
        if (made != 0) {
            H5free_memory(*data);
            *data = out.release();
            *capacity = size;
            return made;
        }
        if (errno != E2BIG || size == most) {
            return 0;
        }
    }
}

}  // namespace

void register_lzf_filter() {
    static std::once_flag once;
    std::call_once(once, [] {
        static const H5Z_class2_t description{H5Z_CLASS_T_VERS, kLzfFilter, 0,          1, "lzf",
                                              nullptr,          nullptr,    &lzf_filter};
        if (H5Zfilter_avail(kLzfFilter) <= 0) {
            H5Zregister(&description);
        }
    });
}

bool has_lzf() {
    return true;
}

bool undo_lzf(std::span<const std::byte> in, std::span<std::byte> out) {
    return ::lzf_decompress(in.data(), static_cast<unsigned>(in.size()), out.data(),
                            static_cast<unsigned>(out.size())) == out.size();
}
#else
void register_lzf_filter() {}

bool has_lzf() {
    return false;
}

bool undo_lzf(std::span<const std::byte>, std::span<std::byte>) {
    return false;
}
#endif

}  // namespace isonest::detail
