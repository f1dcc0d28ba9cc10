#include "preprocess/ranks/block_journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <system_error>
#include <utility>

#include <isonest/error.h>
#include <isonest/field.h>

#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

constexpr std::string_view kJournalEnd = ".blocks";
constexpr std::uint64_t kJournalMark = 0x315352544e4f5349;  // "ISONTRS1"

/// Start of a journal; the text of the identity follows.
struct JournalHead {
    std::uint64_t mark = kJournalMark;
    std::uint64_t identity_bytes = 0;
};

/// Precedes a block's rows of the chunk table, its centres and its ranges of cubes.
struct BlockHead {
    std::uint64_t check = 0;  ///< XXH64 of everything after it
    Int3 block;
    std::uint64_t offset = 0;  ///< in the file of chunks
    std::uint64_t bytes = 0;   ///< after this head
};

/// The cubes of a block at a level; a block has `count` of them per axis.
template <class T>
Box<T> cubes_of(const Int3& block, std::int64_t count, const Int3& all) {
    const Int3 lo = block * count;
    return {lo, max(min(lo + Int3{count, count, count}, all) - lo, {0, 0, 0})};
}

bool carries_centres(const StoreLayout& layout) {
    return layout.lattice().top() > kBasePass;
}

/// Calls f(field, box) for the centres of a block that are passed to coarser levels.
template <class F>
void each_centre_box(const StoreLayout& layout, const Int3& block, const F& f) {
    if (carries_centres(layout)) {
        for (const Field field : layout.header().fields) {
            f(field, cubes_of<float>(block, layout.header().chunk / 2,
                                     layout.lattice().elements_at(kBasePass)));
        }
    }
}

/// Empty if there are no ranges.
Box<CubeRange> range_box(const StoreLayout& layout, const Int3& block) {
    return has_cube_ranges(layout.lattice(), kFirstRangeLevel)
               ? cubes_of<CubeRange>(block, cube_ranges_per_block(layout.header().chunk),
                                     layout.lattice().cells_at(kFirstRangeLevel))
               : Box<CubeRange>();
}

template <class T>
void append(std::vector<std::byte>& to, std::span<const T> numbers) {
    const auto bytes = std::as_bytes(numbers);
    to.insert(to.end(), bytes.begin(), bytes.end());
}

/// Removes the first numbers from `from`.
template <class T>
void take_first(std::span<const std::byte>& from, std::span<T> numbers) {
    std::memcpy(numbers.data(), from.data(), numbers.size_bytes());
    from = from.subspan(numbers.size_bytes());
}

/// Name of the file with a journal's chunks.
std::filesystem::path chunks_name(const std::filesystem::path& journal) {
    std::filesystem::path name = journal;
    return name.replace_extension(".chunks");
}

Error changed(const std::filesystem::path& journal) {
    return {ErrorKind::io, {journal.string()}, "the file changed while it was being read"};
}

}  // namespace

struct EarlierBlocks::Record {
    BlockHead head;
    std::vector<std::byte> body;
};

std::filesystem::path rank_files_prefix(const std::filesystem::path& scratch,
                                        const std::filesystem::path& store) {
    return scratch / fmt::format(".{}.ranks-", store.filename().string());
}

BlockJournal::BlockJournal(std::filesystem::path name, std::string identity,
                           const StoreLayout& layout, const CentreStore& centres)
    : name_(std::move(name)),
      identity_(std::move(identity)),
      layout_(&layout),
      centres_(&centres) {}

BlockJournal::Files& BlockJournal::files() {
    if (!files_) {
        files_.emplace(Files{ScratchFile::named(name_), ScratchFile::named(chunks_name(name_))});
        files_->blocks.lock();
        const JournalHead head{kJournalMark, identity_.size()};
        std::vector<std::byte> bytes;
        append(bytes, std::span(&head, 1));
        append(bytes, std::span<const char>(identity_));
        files_->blocks.write_at(0, bytes);
        blocks_end_ = bytes.size();
    }
    return *files_;
}

void BlockJournal::keep() {
    if (files_) {
        files_->blocks.keep();
        files_->chunks.keep();
    }
}

ChunkRun BlockJournal::add(const Int3& block, std::span<const EncodedChunk> chunks) {
    Files& files = this->files();
    BlockHead head{0, block, chunks_end_, 0};
    std::vector<std::byte> bytes;
    append(bytes, std::span<const BlockHead>(&head, 1));
    for (const EncodedChunk& chunk : chunks) {
        files.chunks.write_at(chunks_end_, chunk.bytes);
        chunks_end_ += chunk.bytes.size();
        append(bytes, std::span(&chunk.row, 1));
    }
    each_centre_box(*layout_, block, [&](Field field, Box<float> box) {
        centres_->get(kBasePass, field, 0.0F, box);
        append(bytes, std::span<const float>(box.data));
    });
    const Box<CubeRange> ranges = range_box(*layout_, block);
    const Int3 cells = layout_->lattice().cells_at(kFirstRangeLevel);
    for (std::int64_t z = ranges.lo.z; z < ranges.lo.z + ranges.size.z; ++z) {
        for (std::int64_t y = ranges.lo.y; y < ranges.lo.y + ranges.size.y; ++y) {
            append(bytes, std::span<const CubeRange>(centres_->cube_ranges(kFirstRangeLevel))
                              .subspan(static_cast<std::size_t>(cells.linear({ranges.lo.x, y, z})),
                                       static_cast<std::size_t>(ranges.size.x)));
        }
    }
    head.bytes = bytes.size() - sizeof(head);
    std::memcpy(bytes.data(), &head, sizeof(head));
    head.check = checksum_of(std::span(bytes).subspan(sizeof(head.check)));
    std::memcpy(bytes.data(), &head, sizeof(head));
    files.blocks.write_at(blocks_end_, bytes);
    blocks_end_ += bytes.size();
    return {files.chunks.descriptor(), head.offset};
}

EarlierBlocks::EarlierBlocks(const std::filesystem::path& scratch,
                             const std::filesystem::path& store, const std::string& identity,
                             const StoreLayout& layout)
    : layout_(&layout), grid_(base_grid(layout)), table_(ScratchFolder(scratch)) {
    table_.map(static_cast<std::uint64_t>(grid_.product()) * sizeof(Place));
    const std::string prefix = rank_files_prefix(scratch, store).filename().string();
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(scratch, ignored)) {
        const std::string name = entry.path().filename().string();
        if (name.starts_with(prefix) && name.ends_with(kJournalEnd)) {
            read_journal(entry.path(), identity);
        }
    }
}

EarlierBlocks::~EarlierBlocks() {
    for (const Journal& journal : journals_) {
        ::close(journal.blocks);
        ::close(journal.chunks);
    }
}

void EarlierBlocks::read_journal(const std::filesystem::path& name, const std::string& identity) {
    // On NFS, only files opened for writing can be locked exclusively.
    Journal journal{name, ::open(name.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW), -1};
    if (journal.blocks < 0) {
        return;
    }
    JournalHead head;
    std::string found(identity.size(), '\0');
    const bool is_dead = ::flock(journal.blocks, LOCK_SH | LOCK_NB) == 0;
    const bool is_journal =
        is_dead && pread_whole(journal.blocks, 0, std::as_writable_bytes(std::span(&head, 1))) &&
        head.mark == kJournalMark;
    const bool is_same =
        is_journal && head.identity_bytes == identity.size() &&
        pread_whole(journal.blocks, sizeof(head), std::as_writable_bytes(std::span(found))) &&
        found == identity;
    if (is_same) {
        journal.chunks = ::open(chunks_name(name).c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    }
    if (journal.chunks < 0) {
        ::close(journal.blocks);
        if (is_journal && !is_same) {
            throw Error(
                ErrorKind::invalid_argument, {name.string()},
                "left by an interrupted run for this store that had another input or other options",
                {{RemedyKind::same_options}, {RemedyKind::remove_leftover}});
        }
        return;
    }
    journals_.push_back(journal);
    std::uint64_t offset = sizeof(head) + identity.size();
    while (const std::optional<Record> next = record(journal, offset)) {
        table_.as<Place>()[static_cast<std::size_t>(grid_.linear(next->head.block))] = {
            journals_.size(), offset};
        offset += sizeof(BlockHead) + next->head.bytes;
    }
}

/// Nullopt if there is no intact record.
std::optional<EarlierBlocks::Record> EarlierBlocks::record(const Journal& journal,
                                                           std::uint64_t offset) const {
    Record found;
    if (!pread_whole(journal.blocks, offset, std::as_writable_bytes(std::span(&found.head, 1)))) {
        return std::nullopt;
    }
    const Int3& block = found.head.block;
    if (min(block, {0, 0, 0}) != Int3{0, 0, 0} ||
        max(block, grid_ - Int3{1, 1, 1}) != grid_ - Int3{1, 1, 1}) {
        return std::nullopt;
    }
    std::uint64_t bytes =
        chunks_of(*layout_, kBasePass, block).size() * sizeof(ChunkRow) +
        static_cast<std::uint64_t>(range_box(*layout_, block).size.product()) * sizeof(CubeRange);
    each_centre_box(*layout_, block, [&](Field /*field*/, const Box<float>& box) {
        bytes += box.data.size() * sizeof(float);
    });
    if (found.head.bytes != bytes) {
        return std::nullopt;
    }
    std::vector<std::byte> all(sizeof(found.head) + bytes);
    std::memcpy(all.data(), &found.head, sizeof(found.head));
    if (!pread_whole(journal.blocks, offset + sizeof(found.head),
                     std::span(all).subspan(sizeof(found.head))) ||
        checksum_of(std::span(all).subspan(sizeof(found.head.check))) != found.head.check) {
        return std::nullopt;
    }
    found.body.assign(all.begin() + sizeof(found.head), all.end());
    return found;
}

bool EarlierBlocks::has_whole(const Int3& block) const {
    const Place place = place_in_table(block);
    if (place.journal == 0) {
        return false;
    }
    const Journal& journal = journal_of(block);
    const std::optional<Record> found = record(journal, place.offset);
    if (!found) {
        return false;
    }
    std::span<const std::byte> body = found->body;
    std::uint64_t offset = found->head.offset;
    std::vector<std::byte> bytes;
    for (const ChunkPlace& chunk : chunks_of(*layout_, kBasePass, block)) {
        ChunkRow row;
        take_first(body, std::span(&row, 1));
        if (row.bytes > 2 * chunk.array->chunk_bytes() + 1024) {
            return false;
        }
        bytes.resize(row.bytes);
        if (!pread_whole(journal.chunks, offset, bytes) || checksum_of(bytes) != row.checksum) {
            return false;
        }
        offset += row.bytes;
    }
    return true;
}

const EarlierBlocks::Journal& EarlierBlocks::journal_of(const Int3& block) const {
    return journals_[place_in_table(block).journal - 1];
}

EarlierBlocks::Record EarlierBlocks::known_record(const Int3& block) const {
    const Journal& journal = journal_of(block);
    std::optional<Record> found = record(journal, place_in_table(block).offset);
    if (!found) {
        throw changed(journal.name);
    }
    return std::move(*found);
}

ChunkRun EarlierBlocks::place_of(const Int3& block) const {
    return {journal_of(block).chunks, known_record(block).head.offset};
}

std::vector<EncodedChunk> EarlierBlocks::load(const Int3& block, CentreStore& centres) const {
    const Journal& journal = journal_of(block);
    const Record found = known_record(block);
    std::span<const std::byte> body = found.body;
    std::uint64_t offset = found.head.offset;
    std::vector<EncodedChunk> chunks;
    for (const ChunkPlace& place_of_chunk : chunks_of(*layout_, kBasePass, block)) {
        EncodedChunk chunk;
        chunk.array = place_of_chunk.array;
        chunk.chunk = place_of_chunk.chunk;
        take_first(body, std::span(&chunk.row, 1));
        chunk.bytes.resize(chunk.row.bytes);
        if (!pread_whole(journal.chunks, offset, chunk.bytes) ||
            checksum_of(chunk.bytes) != chunk.row.checksum) {
            throw changed(journal.name);
        }
        offset += chunk.row.bytes;
        chunks.push_back(std::move(chunk));
    }
    each_centre_box(*layout_, block, [&](Field field, Box<float> box) {
        take_first(body, std::span(box.data));
        centres.put(kBasePass, field, box);
    });
    if (has_cube_ranges(layout_->lattice(), kFirstRangeLevel)) {
        Box<CubeRange> ranges = range_box(*layout_, block);
        take_first(body, std::span(ranges.data));
        centres.put(ranges);
    }
    return chunks;
}

void EarlierBlocks::remove() const {
    std::error_code ignored;
    for (const Journal& journal : journals_) {
        // Unlock first: a failed conversion might keep the old lock, and others wait for its
        // release.
        ::flock(journal.blocks, LOCK_UN);
        if (::flock(journal.blocks, LOCK_EX | LOCK_NB) == 0) {
            std::filesystem::remove(journal.name, ignored);
            std::filesystem::remove(chunks_name(journal.name), ignored);
        }
    }
}

}  // namespace isonest::detail
