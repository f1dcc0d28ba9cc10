// File drivers for HDF5. Private to the store.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

// An HDF5 file driver that reads a StoreBytes, so that HDF5 files can be anywhere.

/// For remote bytes, small reads of HDF5 are answered from aligned blocks of kDriverBlock bytes.
/// The most recently used blocks are kept: at most kDriverHolds bytes for each open file, and a
/// quarter more while they are fetched. Reads of a block or more are passed on unchanged.
inline constexpr std::size_t kDriverBlock = std::size_t{64} << 10U;
inline constexpr std::size_t kDriverHolds = std::size_t{4} << 20U;

/// HDF5 1.10 leaks memory when a read fails, and reports that when the process ends, unless its
/// exit handler is disabled. No effect if HDF5 is already in use. Thread-safe.
void close_nothing_at_exit();

/// Opens for reading. The handle is invalid if these bytes are not an HDF5 file. Throws what
/// StoreBytes::read() throws. The driver never opens other files that this one refers to: external
/// links and virtual datasets that point to them fail or are empty. HDF5's lock is held while the
/// bytes are read, so a process has only one such read at a time.
FileHandle open_hdf5(std::shared_ptr<const StoreBytes> bytes);

/// Exceptions cannot pass through HDF5. If reading the bytes throws, the read fails in HDF5, and
/// this function throws that exception. From then on no byte of the file is read, and every call
/// throws: HDF5 1.10 treats what it could not read as missing and remembers that, so the file has
/// to be opened again. Does nothing if no read has failed, and for files opened by path. `file` may
/// be any object in the file. Thread-safe.
void rethrow_failed_read(hid_t file);

/// Whether the file (or the object's file) was opened by open_hdf5(bytes).
bool is_of_bytes(hid_t object);

/// The byte ranges of the file's raw data that HDF5 would read for f(), in its order. They are
/// recorded but not read: f()'s memory keeps its previous contents. Metadata are read. Used to find
/// chunks, by H5Dread_chunk(), which looks up each one; the function that HDF5 1.10 offers for this
/// visits all chunks each time. `file` may be any object in the file. REQUIRES: is_of_bytes(file);
/// HDF5 caches nothing that f() reads (no sieve buffer, no chunk cache).
std::vector<ByteRange> raw_reads_of(hid_t file, const std::function<void()>& f);

/// Calls f(), which reads from `file` and may throw because HDF5 failed. If reading the bytes has
/// failed, throws that exception instead, even if f() treated the data as missing.
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

// An HDF5 file driver that creates all of HDF5's structures and drops the raw data, which others
// will write at the places that HDF5 has chosen.

/// Shared between the driver and the planner of the file.
struct PlannedWrites {
    bool drops_raw = false;  ///< true: raw data are dropped from now on; false: they are written
    std::uint64_t last = 0;  ///< file offset of the raw data that were dropped last
};

/// Files created with these properties use the driver. It writes the same bytes to the same places
/// as HDF5's default driver. REQUIRES: `writes` lives as long as the file. Thread-safety: as HDF5;
/// `writes` must not be accessed during HDF5 calls.
void use_planned_writes(const PropertyHandle& access, PlannedWrites& writes);

}  // namespace isonest::detail
