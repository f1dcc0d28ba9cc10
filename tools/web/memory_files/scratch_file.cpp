// Temporary files where there is no disk: in memory, as one piece each. A map is that memory, so it
// is invalid after a write behind its end.
#include "store/files/scratch_file.h"

#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <utility>

namespace isonest::detail {
namespace {

/// A buffer that grows is longer by a part of so much, at least.
constexpr std::uint64_t kGrowth = 4;

/// `bytes` of room at least, with what was there. Throws std::bad_alloc, which callers take for a
/// limit of the memory.
std::byte* with_room(std::byte* buffer, std::uint64_t bytes) {
    const std::size_t room = buffer == nullptr ? 0 : ::malloc_usable_size(buffer);
    if (bytes <= room) {
        return buffer;
    }
    if (bytes > std::numeric_limits<std::size_t>::max()) {
        throw std::bad_alloc();
    }
    const std::uint64_t more = std::min<std::uint64_t>(std::max(bytes, room + room / kGrowth),
                                                       std::numeric_limits<std::size_t>::max());
    void* grown = std::realloc(buffer, static_cast<std::size_t>(more));
    if (grown == nullptr) {
        grown = std::realloc(buffer, static_cast<std::size_t>(bytes));
    }
    if (grown == nullptr) {
        throw std::bad_alloc();
    }
    return static_cast<std::byte*>(grown);
}

}  // namespace

void ScratchMeter::add(std::uint64_t bytes) {
    now_ += bytes;
    peak_ = std::max<std::uint64_t>(peak_, now_);
}

ScratchFolder ScratchFolder::metered(const std::filesystem::path& path) {
    return {path, std::make_shared<ScratchMeter>()};
}

ScratchFile::ScratchFile(const ScratchFolder& folder) : meter_(folder.meter()) {}

ScratchFile::ScratchFile(ScratchFile&& other) noexcept {
    take(other);
}

ScratchFile& ScratchFile::operator=(ScratchFile&& other) noexcept {
    if (this != &other) {
        close();
        take(other);
    }
    return *this;
}

ScratchFile::~ScratchFile() {
    close();
}

void ScratchFile::take(ScratchFile& other) noexcept {
    meter_ = std::move(other.meter_);
    end_ = other.end_.exchange(0);
    counted_ = other.counted_.exchange(0);
    map_ = std::exchange(other.map_, nullptr);
    mapped_ = std::exchange(other.mapped_, 0);
}

void ScratchFile::close() {
    std::free(map_);
    map_ = nullptr;
    mapped_ = 0;
    end_ = 0;
    uncount(counted_);
}

void ScratchFile::uncount(std::uint64_t bytes) const {
    counted_ -= bytes;
    if (meter_) {
        meter_->remove(bytes);
    }
}

/// The file has that many bytes, those that nobody wrote are 0.
void ScratchFile::count_to(std::uint64_t end) {
    if (end <= end_) {
        return;
    }
    map_ = with_room(map_, end);
    std::memset(map_ + end_, 0, static_cast<std::size_t>(end - end_));
    counted_ += end - end_;
    if (meter_) {
        meter_->add(end - end_);
    }
    end_ = end;
}

void ScratchFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    if (!bytes.empty()) {
        count_to(offset + bytes.size());
        std::memcpy(map_ + offset, bytes.data(), bytes.size());
    }
}

void ScratchFile::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
    if (!bytes.empty()) {
        std::memcpy(bytes.data(), map_ + offset, bytes.size());
    }
}

std::span<std::byte> ScratchFile::map(std::uint64_t bytes) {
    count_to(bytes);
    mapped_ = bytes;
    return {map_, static_cast<std::size_t>(bytes)};
}

void ScratchFile::clear() {
    close();
}

/// The space is in use until the end.
void ScratchFile::release(std::uint64_t /*offset*/, std::uint64_t /*bytes*/) const {}

}  // namespace isonest::detail
