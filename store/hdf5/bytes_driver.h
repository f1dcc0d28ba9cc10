// HDF5 files that lie anywhere: a file driver for HDF5 that reads a StoreBytes. Private to the
// store.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Of far bytes, HDF5's small reads are answered from aligned blocks of kDriverBlock bytes, of
/// which those used last are held: at most kDriverHolds bytes for each open file, and a quarter
/// more while they come. Reads of a block or more go to the bytes as they are.
inline constexpr std::size_t kDriverBlock = std::size_t{64} << 10U;
inline constexpr std::size_t kDriverHolds = std::size_t{4} << 20U;

/// HDF5 1.10 loses memory where a read fails, and complains about that when the process ends,
/// unless it does nothing then. Without effect where HDF5 is in use already. Thread-safe.
void close_nothing_at_exit();

/// Opens for reading. Invalid where these bytes are no HDF5 file. Throws what StoreBytes::read()
/// throws. Other files that this one names are never opened by the driver: external links and
/// virtual datasets that lead to them fail or are empty.
/// HDF5's lock is held while the bytes are read, so a process has one such read at a time.
FileHandle open_hdf5(std::shared_ptr<const StoreBytes> bytes);

/// Nothing can be thrown through HDF5: a read of the bytes that throws fails in HDF5, and this
/// function throws what that has thrown. After it no further byte of the file is read, and this
/// throws whenever it is called: HDF5 1.10 takes what it could not read for something that is not
/// there, and remembers it, so that the file has to be opened again. Does nothing where no read has
/// failed, and for files opened by a path. `file` may be any object in the file, too. Thread-safe.
void rethrow_failed_read(hid_t file);

/// Whether the file, or what the object lies in, was opened by open_hdf5(bytes).
bool is_of_bytes(hid_t object);

/// Which bytes of the file's raw data HDF5 would read for f(), in its order: they are noted and not
/// read, and what f() gets in their place is what was in its memory before. Metadata are read.
/// Chunks are found so, by H5Dread_chunk(), which looks each one up; what HDF5 1.10 offers for it
/// walks over all chunks each time. `file` may be any object in the file. REQUIRES:
/// is_of_bytes(file); nothing of what f() reads is kept by HDF5 (no sieve buffer, no chunk cache).
std::vector<ByteRange> raw_reads_of(hid_t file, const std::function<void()>& f);

/// f(), which reads from `file` and may throw because HDF5 could not: if reading the bytes has
/// failed, that is thrown instead, also where f() took it for something that is missing.
template <class F>
std::invoke_result_t<F> reading(hid_t file, F&& f) {
    if constexpr (std::is_void_v<std::invoke_result_t<F>>) {
        reading(file, [&] {
            std::forward<F>(f)();
            return true;
        });
    } else {
        std::optional<std::invoke_result_t<F>> result;
        try {
            result.emplace(std::forward<F>(f)());
        } catch (...) {
            rethrow_failed_read(file);
            throw;
        }
        rethrow_failed_read(file);
        return std::move(*result);
    }
}

}  // namespace isonest::detail
