// A page is a single process and keeps nothing between visits: it has no other ranks and no kept
// analyses. The library only needs them if they are named, which no request of a page can do.

#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <stdexcept>
#include <utility>

#include <isonest/error.h>

#include "query/extract/extract_shared.h"
#include "query/extract/kept_analysis.h"
#include "query/ranks/cube_shares.h"
#include "query/ranks/mesh_on_ranks.h"
#include "query/ranks/rank_mapping.h"
#include "query/simplify/collapse/map_mesh.h"
#include "store/container/reader.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {
namespace {

[[noreturn]] void nobody_is_there() {
    throw std::logic_error("pages support neither ranks nor kept analyses");
}

}  // namespace

std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, const MemoryShare& /*memory*/) {
    if (team != nullptr) {
        nobody_is_there();
    }
    return std::make_unique<LocalMapping>();
}

bool is_written_by_all(MeshSink& /*sink*/) {
    return false;
}

void begin_shared_traversal(RankTeam& /*team*/, const StoreReader& /*store*/,
                            const ExtractQuery& /*asked*/, std::span<const double> /*isovalues*/) {
    nobody_is_there();
}

void begin_shared_mesh(RankTeam& /*team*/, std::size_t /*i*/) {
    nobody_is_there();
}

SettledParts settle_parts(Communicator& /*ranks*/, PartStore& /*parts*/,
                          const std::function<bool()>& /*may_stay*/) {
    nobody_is_there();
}

MeshOnRanks mesh_on_ranks(RankTeam& /*team*/, PartStore& /*parts*/,
                          std::optional<ApartRange> /*apart*/, MeshLayout /*layout*/,
                          MeshSink& /*sink*/, const ScratchFolder& /*folder*/,
                          Progress& /*progress*/) {
    nobody_is_there();
}

CubeShare share_of(Communicator& /*ranks*/, const ChunkSource& /*source*/, const ClipBox& /*box*/,
                   const std::optional<LatticePlane>& /*plane*/,
                   std::span<const double> /*isovalues*/) {
    nobody_is_there();
}

void Communicator::sum(std::span<std::uint64_t> /*numbers*/) {
    nobody_is_there();
}

void Communicator::largest(std::span<double> /*numbers*/) {
    nobody_is_there();
}

std::optional<ExtractReport> extract_analysed(const StoreReader& /*store*/,
                                              const ExtractQuery& /*query*/, MeshSink& /*sink*/,
                                              const ExtractOptions& /*options*/,
                                              Progress& /*progress*/) {
    nobody_is_there();
}

std::filesystem::path analysis_folder_of(const StoreReader& /*store*/) {
    nobody_is_there();
}

// A page opens stores only by their catalogues, because it contains no HDF5.

void StoreReader::open_by_hdf5() {
    throw Error(ErrorKind::unsupported, {path_.string()},
                "not a store with a footer: pages open only stores of format 2.9 or newer that no "
                "other program has changed",
                {{RemedyKind::preprocess_again}});
}

// PiecedFile in memory: all pieces are one file, whose memory is freed when all of it has been
// released.

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

// Temporary files without a disk: in memory, each in one piece. A map is that memory, so it becomes
// invalid when a write extends the file.

namespace {

/// A buffer grows by at least 1 / kGrowth of its size.
constexpr std::uint64_t kGrowth = 4;

/// Returns a buffer with space for at least `bytes` and the previous contents. Throws
/// std::bad_alloc, which callers treat as a memory limit.
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

/// Extends the file to this many bytes; those never written are 0.
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

/// The space remains in use until the end.
void ScratchFile::release(std::uint64_t /*offset*/, std::uint64_t /*bytes*/) const {}

}  // namespace isonest::detail
