// In memory a file in pieces is one piece: what was released is given back when all of it was.
#include "store/files/pieced_file.h"

#include <utility>

namespace isonest::detail {

PiecedFile::PiecedFile(PiecedFile&& other) noexcept
    : folder_(std::move(other.folder_)),
      pieces_(std::move(other.pieces_)),
      map_(std::exchange(other.map_, nullptr)),
      mapped_(std::exchange(other.mapped_, 0)) {}

PiecedFile::Piece& PiecedFile::piece(std::size_t /*number*/) {
    if (pieces_.empty()) {
        pieces_.push_back(std::make_unique<Piece>(folder_));
    }
    return *pieces_.front();
}

void PiecedFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    piece(0).file.write_at(offset, bytes);
}

std::span<std::byte> PiecedFile::map(std::uint64_t bytes) {
    map_ = bytes == 0 ? nullptr : piece(0).file.map(bytes).data();
    mapped_ = bytes;
    return {map_, static_cast<std::size_t>(bytes)};
}

void PiecedFile::release(std::uint64_t /*offset*/, std::uint64_t bytes) {
    if ((piece(0).released += bytes) == mapped_) {
        pieces_.clear();
    }
}

void PiecedFile::clear() {
    unmap();
    pieces_.clear();
}

void PiecedFile::unmap() {
    map_ = nullptr;
    mapped_ = 0;
}

}  // namespace isonest::detail
