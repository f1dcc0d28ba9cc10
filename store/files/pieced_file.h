// Temporary space on disk that is given back piece by piece.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "store/files/scratch_file.h"

namespace isonest::detail {

/// As one ScratchFile, but in several, whose maps follow each other in memory. So what nobody needs
/// any more can be given back by closing a file, at no cost: a hole in a file is often written to
/// the disk before it is made. Pieces are larger the further they are from the beginning, so that
/// there are few of them, each a small share of those before. Thread-safety: write_at() and
/// release() of disjoint ranges from any thread; the rest from one.
class PiecedFile {
  public:
    explicit PiecedFile(ScratchFolder folder) : folder_(std::move(folder)) {}
    PiecedFile(PiecedFile&& other) noexcept;
    PiecedFile& operator=(PiecedFile&& other) = delete;
    PiecedFile(const PiecedFile&) = delete;
    PiecedFile& operator=(const PiecedFile&) = delete;
    ~PiecedFile() { unmap(); }

    /// Throws Error{io}, for example on a full disk.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes);
    /// Maps the first `bytes` for reading and writing; what was not written is 0. REQUIRES: nothing
    /// was released. Throws Error{io}, std::bad_alloc.
    std::span<std::byte> map(std::uint64_t bytes);
    /// Nobody will look at a range any more, each byte of which is released once. Its space is
    /// given back when all of a piece was released. REQUIRES: map() was called.
    void release(std::uint64_t offset, std::uint64_t bytes);
    /// Gives all the space back. Earlier maps become invalid.
    void clear();
    /// The current map as an array of T.
    template <class T>
    [[nodiscard]] std::span<T> as() const {
        return {reinterpret_cast<T*>(map_), static_cast<std::size_t>(mapped_ / sizeof(T))};
    }

  private:
    struct Piece {
        explicit Piece(const ScratchFolder& folder) : file(folder) {}
        ScratchFile file;
        std::atomic<std::uint64_t> released = 0;
    };
    /// f(piece, offset in it, bytes) for the pieces of a range.
    template <class F>
    static void each_piece(std::uint64_t offset, std::uint64_t bytes, const F& f);
    Piece& piece(std::size_t number);
    void unmap();

    ScratchFolder folder_;
    std::mutex mutex_;
    std::vector<std::unique_ptr<Piece>> pieces_;
    std::byte* map_ = nullptr;
    std::uint64_t mapped_ = 0;
};

}  // namespace isonest::detail
