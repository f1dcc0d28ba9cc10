#include "store/files/pieced_file.h"

#include <sys/mman.h>

#include <algorithm>
#include <bit>
#include <new>
#include <utility>

namespace isonest::detail {
namespace {

/// Pieces of one size before the next ones are twice as large.
constexpr std::uint64_t kOfASize = 8;
/// Bytes of the first one; a multiple of what pages have.
constexpr std::uint64_t kFirst = std::uint64_t{1} << 18U;

/// A piece's place in the whole.
struct Place {
    std::uint64_t number;
    std::uint64_t begin;
    std::uint64_t size;
};

Place place_of(std::uint64_t offset) {
    // Before those of 2^k times the first size there are kOfASize * (2^k - 1) times that size.
    constexpr std::uint64_t kGroup = kOfASize * kFirst;
    const auto k = static_cast<std::uint64_t>(std::bit_width((offset / kGroup + 1) / 2));
    const std::uint64_t group = kGroup * ((std::uint64_t{1} << k) - 1);
    const std::uint64_t size = kFirst << k;
    const std::uint64_t in_group = (offset - group) / size;
    return {k * kOfASize + in_group, group + in_group * size, size};
}

void* mapped_nowhere(void* at, std::uint64_t bytes) {
    const int fixed = at != nullptr ? MAP_FIXED : 0;
    void* const p =
        ::mmap(at, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | fixed, -1, 0);
    if (p == MAP_FAILED) {
        throw std::bad_alloc();
    }
    return p;
}

}  // namespace

template <class F>
void PiecedFile::each_piece(std::uint64_t offset, std::uint64_t bytes, const F& f) {
    while (bytes > 0) {
        const Place at = place_of(offset);
        const std::uint64_t here = std::min(bytes, at.begin + at.size - offset);
        f(at, offset - at.begin, here);
        offset += here;
        bytes -= here;
    }
}

PiecedFile::PiecedFile(PiecedFile&& other) noexcept
    : folder_(std::move(other.folder_)),
      pieces_(std::move(other.pieces_)),
      map_(std::exchange(other.map_, nullptr)),
      mapped_(std::exchange(other.mapped_, 0)) {}

PiecedFile::Piece& PiecedFile::piece(std::size_t number) {
    const std::lock_guard lock(mutex_);
    if (pieces_.size() <= number) {
        pieces_.resize(number + 1);
    }
    if (!pieces_[number]) {
        pieces_[number] = std::make_unique<Piece>(folder_);
    }
    return *pieces_[number];
}

void PiecedFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    each_piece(offset, bytes.size(),
               [&](const Place& at, std::uint64_t begin, std::uint64_t count) {
                   piece(at.number).file.write_at(begin, bytes.first(count));
                   bytes = bytes.subspan(count);
               });
}

std::span<std::byte> PiecedFile::map(std::uint64_t bytes) {
    unmap();
    if (bytes == 0) {
        return {};
    }
    map_ = static_cast<std::byte*>(mapped_nowhere(nullptr, bytes));
    mapped_ = bytes;
    each_piece(0, bytes, [&](const Place& at, std::uint64_t /*begin*/, std::uint64_t count) {
        piece(at.number).file.map_at(map_ + at.begin, count);
    });
    return {map_, bytes};
}

void PiecedFile::release(std::uint64_t offset, std::uint64_t bytes) {
    each_piece(offset, bytes, [&](const Place& at, std::uint64_t /*begin*/, std::uint64_t count) {
        Piece& released = piece(at.number);
        const std::uint64_t size = std::min(at.size, mapped_ - at.begin);
        // Of several threads, the one that completes it.
        const std::uint64_t so_far = released.released.fetch_add(count) + count;
        if (so_far == size) {
            mapped_nowhere(map_ + at.begin, size);
            const std::lock_guard lock(mutex_);
            pieces_[at.number].reset();
        }
    });
}

void PiecedFile::clear() {
    unmap();
    pieces_.clear();
}

void PiecedFile::unmap() {
    if (map_ != nullptr) {
        ::munmap(map_, mapped_);
    }
    map_ = nullptr;
    mapped_ = 0;
}

}  // namespace isonest::detail
