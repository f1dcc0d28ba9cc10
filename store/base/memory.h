// Memory budgets, heap that must be available, and alignment.
#pragma once

#include <sys/mman.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail {

// The rule of every memory budget: the minimum that a call needs, and the error if it gets less.

/// Heap that is not divided by any budget: used by the program itself, HDF5 and TBB. Measured by
/// tools/bench/peak_heap.cpp: 1.2 to 3.4 MB on a store of 9^3 nodes, for any command that draws no
/// picture. The rest is for parts that grow slowly (HDF5's caches, TBB's tasks, names of parts),
/// and for what is kept of a remote store (at most 5.6 MB: ChunkTable, CubeRangeTable).
inline constexpr std::uint64_t kLibraryHeap = std::uint64_t{10} << 20U;

/// Throws Error{limit} if `memory` is less than `least` (bytes). The error's place is `subject`.
/// The message says what the memory is too small for, and the first remedy names a sufficient
/// memory; `also`: further remedies.
void require_memory(const std::string& subject, std::uint64_t memory, std::uint64_t least,
                    const std::string& for_what, std::vector<Remedy> also = {});

/// A share of a memory budget, in bytes of heap, and the number of threads that divide it. It is a
/// value: functions get a share and pass parts of it on. An error names the whole memory required,
/// including what others use and kLibraryHeap.
class MemoryShare {
  public:
    /// The whole budget. `subject`: the place of errors. `threads` > 0.
    MemoryShare(std::string subject, std::uint64_t bytes, int threads)
        : subject_(std::move(subject)), bytes_(bytes), threads_(threads) {}

    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    [[nodiscard]] int threads() const { return threads_; }
    /// Bytes that are not used by others.
    [[nodiscard]] std::uint64_t left() const { return bytes_ - std::min(bytes_, taken_); }

    /// The same budget with another `bytes` in use by others.
    [[nodiscard]] MemoryShare without(std::uint64_t bytes) const {
        MemoryShare rest = *this;
        rest.taken_ += bytes;
        return rest;
    }
    [[nodiscard]] MemoryShare with_threads(int threads) const {
        MemoryShare rest = *this;
        rest.threads_ = threads;
        return rest;
    }
    /// Throws Error{limit} if less than `least` is left. `what`: for the message, what needs it.
    void require(std::uint64_t least, const std::string& what) const {
        require_memory(subject_, bytes_, taken_ + least, what);
    }
    /// The number of threads, each using `each` bytes, for which the memory suffices. Throws
    /// Error{limit} if it is 0.
    [[nodiscard]] int threads_of(std::uint64_t each, const std::string& what) const {
        require(each, what);
        return static_cast<int>(
            std::min<std::uint64_t>(left() / each, static_cast<std::uint64_t>(threads_)));
    }

  private:
    std::string subject_;
    std::uint64_t bytes_;
    int threads_;
    std::uint64_t taken_ = kLibraryHeap;
};

// Heap that must be available before calling a library that does not survive a failed allocation.

/// Throws std::bad_alloc if this many bytes are not available at the moment. Does not keep or touch
/// them. Thread-safe.
inline void require_free_heap(std::size_t bytes) {
    void* const room =
        ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (room == MAP_FAILED) {
        throw std::bad_alloc();
    }
    ::munmap(room, bytes);
}

// Alignment of 64-bit numbers in memory and in our own files.

/// The smallest multiple of 8 that is at least `bytes`.
constexpr std::uint64_t aligned(std::uint64_t bytes) {
    return (bytes + 7) / 8 * 8;
}

}  // namespace isonest::detail
