#include "preprocess/levels/resume.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <sstream>
#include <vector>

#include <isonest/error.h>

#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/files/open_file.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kPending = 1024;

template <class T>
std::span<const std::byte> bytes_of(const T& value) {
    return std::as_bytes(std::span(&value, 1));
}

}  // namespace

std::uint64_t JournalRecord::expected_check() const {
    return checksum_of(bytes_of(*this).first(offsetof(JournalRecord, check)));
}

std::filesystem::path journal_name(const std::filesystem::path& temporary) {
    return temporary.string() + ".journal";
}

std::filesystem::path centres_name(const std::filesystem::path& temporary) {
    return temporary.string() + ".centres";
}

RunJournal::RunJournal(const std::filesystem::path& temporary, const std::string& identity)
    : file_(ScratchFile::named(journal_name(temporary))) {
    // If locks are refused (some network file systems), the process id in the name must suffice.
    file_.lock();
    const std::uint64_t size = identity.size();
    const auto text = std::as_bytes(std::span(identity));
    write(bytes_of(size));
    write(text);
    write(bytes_of(checksum_of(text)));
    pending_.reserve(kPending);
}

void RunJournal::write(std::span<const std::byte> bytes) {
    file_.write_at(end_, bytes);
    end_ += bytes.size();
}

void RunJournal::append(JournalRecord record) {
    record.check = record.expected_check();
    pending_.push_back(record);
    if (pending_.size() >= kPending) {
        flush();
    }
}

void RunJournal::chunk(std::size_t array, std::int64_t index, const ChunkRow& row) {
    append({JournalRecord::chunk_kind, static_cast<std::uint32_t>(array), index, row, 0});
}

void RunJournal::checkpoint(const Checkpoint& done) {
    JournalRecord record;
    record.kind = JournalRecord::checkpoint_kind;
    record.array = static_cast<std::uint32_t>(done.level);
    record.index = done.rows;
    record.row.checksum = done.centres;
    record.row.offset = done.ranges;
    append(record);
    flush();
    ++checkpoints_;
}

void RunJournal::flush() {
    write(std::as_bytes(std::span(pending_)));
    pending_.clear();
}

namespace {

constexpr std::int64_t kMaxBytes = std::int64_t{1} << 20U;

template <class T>
void compare_plane(VolumeSource& source, ChunkCache& cache, std::int64_t z) {
    const ArrayInfo& array = cache.source().layout().array(0, Field::values);
    const Int3 n = array.nodes;
    const std::int64_t step = source.granularity().rows;
    const std::int64_t fitting = kMaxBytes / (n.x * static_cast<std::int64_t>(sizeof(T)));
    const std::int64_t rows = std::clamp<std::int64_t>(fitting / step * step, 1, n.y);
    for (std::int64_t y = 0; y < n.y; y += rows) {
        const std::int64_t ny = std::min(rows, n.y - y);
        Box<T> theirs({0, y, z}, {n.x, ny, 1});
        gather_values(cache, array, theirs);
        std::vector<T> ours(theirs.data.size());
        source.read(z, 1, y, ny, reinterpret_cast<std::byte*>(ours.data()));
        // Bitwise, so that NaN equals itself.
        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
        if (std::memcmp(ours.data(), theirs.data.data(), ours.size() * sizeof(T)) != 0) {
            throw Error(
                ErrorKind::invalid_argument, {source.describe().name, fmt::format("plane {}", z)},
                "the values differ from those of the interrupted run: the input has changed",
                {{RemedyKind::no_resume}});
        }
    }
}

}  // namespace

void require_same_values(VolumeSource& source, const ChunkSource& store, const Checkpoint& done) {
    if (source.sequential() || done.level == 0) {
        return;
    }
    const StoreLayout& layout = store.layout();
    const std::int64_t nz = layout.lattice().nodes().z;
    const std::int64_t end =
        done.level > 2 ? nz : std::min(nz, 2 * layout.header().chunk * done.rows);
    ChunkCache cache(store, std::uint64_t{8} << 20U);
    dispatch(layout.header().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        compare_plane<T>(source, cache, 0);
        compare_plane<T>(source, cache, end - 1);
    });
}

namespace {

constexpr std::uint64_t kLongestIdentity = 65536;

/// Locks the journal of a run that is over; nullopt if the process that made it is still running,
/// or if another one uses its leftovers. The lock must be held as long as they are used: a journal
/// gets its name before its run has locked it, so a journal that was unlocked a moment ago may
/// belong to a live run.
std::optional<FileDescriptor> lock_of_dead(const std::filesystem::path& journal,
                                           const std::string& process) {
    // On NFS, only files opened for writing can be locked exclusively.
    FileDescriptor file(::open(journal.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
    if (file.get() < 0) {
        return std::nullopt;  // not accessible to us
    }
    if (::flock(file.get(), LOCK_EX | LOCK_NB) == 0) {
        return file;
    }
    pid_t id = 0;
    std::from_chars(process.data(), process.data() + process.size(), id);
    const bool is_dead = errno != EWOULDBLOCK && id > 0 && ::kill(id, 0) != 0 && errno == ESRCH;
    return is_dead ? std::optional(std::move(file)) : std::nullopt;
}

template <class T>
bool read_value(std::istream& in, T& value) {
    return static_cast<bool>(in.read(reinterpret_cast<char*>(&value), sizeof(T)));
}

std::optional<std::string> read_identity(std::istream& in) {
    std::uint64_t size = 0;
    if (!read_value(in, size) || size > kLongestIdentity) {
        return std::nullopt;
    }
    std::string text(size, '\0');
    std::uint64_t check = 0;
    if (!in.read(text.data(), static_cast<std::streamsize>(size)) || !read_value(in, check) ||
        check != checksum_of(std::as_bytes(std::span(text)))) {
        return std::nullopt;
    }
    return text;
}

/// "it had 'chunk 64', this one has 'chunk 32'": the first lines that differ.
std::string difference(const std::string& theirs, const std::string& ours) {
    std::istringstream a(theirs);
    std::istringstream b(ours);
    std::string x;
    std::string y;
    do {
        x.clear();
        y.clear();
        std::getline(a, x);
        std::getline(b, y);
    } while (x == y && (a || b));
    return fmt::format("it had '{}', this run has '{}'", x, y);
}

bool next_record(std::istream& in, JournalRecord& record) {
    return read_value(in, record) && record.check == record.expected_check() &&
           (record.kind == JournalRecord::chunk_kind ||
            record.kind == JournalRecord::checkpoint_kind);
}

std::uint64_t checksum(std::span<const std::byte> file,
                       const std::vector<CentreStore::Range>& ranges) {
    std::vector<std::uint64_t> sums;
    sums.reserve(ranges.size());
    for (const CentreStore::Range& range : ranges) {
        sums.push_back(checksum_of(file.subspan(range.offset, range.bytes)));
    }
    return checksum_of(std::as_bytes(std::span(sums)));
}

/// The stored bytes of a chunk record; empty if they are not intact.
std::span<const std::byte> stored(const MappedFile& store, const StoreLayout& layout,
                                  const JournalRecord& record) {
    const std::uint64_t size = store.bytes().size();
    if (record.array >= layout.arrays().size() || layout.arrays()[record.array].alias ||
        record.index < 0 || record.index >= layout.arrays()[record.array].grid.product() ||
        record.row.offset > size || record.row.bytes > size - record.row.offset) {
        return {};
    }
    const auto bytes = store.bytes().subspan(record.row.offset, record.row.bytes);
    return checksum_of(bytes) == record.row.checksum ? bytes : std::span<const std::byte>{};
}

}  // namespace

std::uint64_t checkpoint_checksum(const CentreStore& centres, int chunk, int level,
                                  std::int64_t rows) {
    return checksum(centres.bytes(), centres.ranges_of(chunk, level, rows));
}

std::uint64_t ranges_checksum(const CentreStore& centres, int chunk, std::int64_t rows) {
    return checksum(centres.bytes(), {centres.cube_ranges_of(chunk, rows)});
}

std::optional<InterruptedRun> InterruptedRun::find(const std::filesystem::path& store,
                                                   const std::string& identity) {
    const std::filesystem::path names = temporary_prefix(store);
    const std::string prefix = names.filename().string();
    const std::string suffix = journal_name("").string();
    std::optional<InterruptedRun> best;
    std::optional<Error> other;
    for (const auto& entry : std::filesystem::directory_iterator(names.parent_path())) {
        const std::string name = entry.path().filename().string();
        if (!name.starts_with(prefix) || !name.ends_with(suffix)) {
            continue;
        }
        const std::string process =
            name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
        std::optional<FileDescriptor> lock = lock_of_dead(entry.path(), process);
        if (!lock) {
            continue;
        }
        std::ifstream in(entry.path(), std::ios::binary);
        const std::optional<std::string> theirs = read_identity(in);
        if (!theirs) {
            continue;
        }
        if (*theirs != identity) {
            std::error_code ignored;
            if (!std::filesystem::exists(names.string() + process, ignored)) {
                continue;  // killed after its store got its final name: nothing to continue
            }
            other.emplace(
                ErrorKind::invalid_argument, ErrorPlace{entry.path().string()},
                fmt::format("the interrupted run used a different input or different options: {}",
                            difference(*theirs, identity)),
                std::vector<Remedy>{{RemedyKind::same_options},
                                    {RemedyKind::remove_leftover},
                                    {RemedyKind::no_resume}});
            continue;
        }
        InterruptedRun run(std::move(*lock));
        run.temporary_ = names.string() + process;
        run.records_ = static_cast<std::uint64_t>(in.tellg());
        JournalRecord record;
        for (Mark mark; next_record(in, record);) {
            mark.chunks += record.kind == JournalRecord::chunk_kind ? 1U : 0U;
            if (record.kind == JournalRecord::checkpoint_kind) {
                mark.done = {static_cast<std::int32_t>(record.array), record.index,
                             record.row.checksum, record.row.offset};
                run.marks_.push_back(mark);
            }
        }
        if (!best || run.marks_.size() > best->marks_.size()) {
            best = std::move(run);
        }
    }
    if (!best && other) {
        throw Error(*other);
    }
    return best;
}

Checkpoint InterruptedRun::replay(StoreWriter& writer, CentreStore& centres, RunJournal& journal,
                                  Progress& progress) {
    const StoreLayout& layout = writer.layout();
    std::error_code missing;
    if (marks_.empty() || !std::filesystem::exists(temporary_, missing) ||
        !std::filesystem::exists(centres_name(temporary_), missing)) {
        return {};
    }
    const MappedFile store(temporary_);
    const MappedFile old(centres_name(temporary_));
    if (old.bytes().size() != centres.bytes().size()) {
        return {};
    }
    const auto ranges = [&](const Checkpoint& done) {
        return centres.ranges_of(layout.header().chunk, done.level, done.rows);
    };
    std::ifstream in(journal_name(temporary_), std::ios::binary);
    JournalRecord record;

    progress.begin("check the interrupted run", marks_.back().chunks, "chunks");
    in.seekg(static_cast<std::streamoff>(records_));
    std::size_t intact = 0;
    while (intact < marks_.size() && next_record(in, record)) {
        progress.check();
        progress.advance(1);
        if (record.kind == JournalRecord::checkpoint_kind) {
            ++intact;
        } else if (stored(store, layout, record).empty()) {
            break;
        }
    }
    const auto cube_ranges = [&](const Checkpoint& done) {
        return centres.cube_ranges_of(layout.header().chunk, done.rows);
    };
    // Continuing at level L needs the centres of the two levels below it; older ones were released.
    const auto has_centres = [&](std::size_t last) {
        return std::all_of(
            marks_.begin(), marks_.begin() + static_cast<std::ptrdiff_t>(last) + 1,
            [&](const Mark& m) {
                return (m.done.level < marks_[last].done.level - 1 ||
                        checksum(old.bytes(), ranges(m.done)) == m.done.centres) &&
                       (m.done.level > 2 ||
                        checksum(old.bytes(), {cube_ranges(m.done)}) == m.done.ranges);
            });
    };
    while (intact > 0 && !has_centres(intact - 1)) {
        --intact;
    }
    if (intact == 0) {
        return {};
    }
    const Mark& last = marks_[intact - 1];
    chunks_ = last.chunks;
    progress.begin("resume", last.chunks, "chunks");
    in.clear();
    in.seekg(static_cast<std::streamoff>(records_));
    for (std::size_t mark = 0; mark < intact && next_record(in, record);) {
        progress.check();
        if (record.kind == JournalRecord::checkpoint_kind) {
            const Checkpoint& done = marks_[mark++].done;
            const auto copy = [&](const CentreStore::Range& range) {
                std::memcpy(centres.bytes().data() + range.offset,
                            old.bytes().data() + range.offset, range.bytes);
            };
            if (done.level >= last.done.level - 1) {
                const auto pieces = ranges(done);
                std::for_each(pieces.begin(), pieces.end(), copy);
            }
            if (done.level == 2) {
                copy(cube_ranges(done));
            }
            journal.checkpoint(done);
            continue;
        }
        const ArrayInfo& array = layout.arrays()[record.array];
        const Int3 chunk = array.grid.unlinear(record.index);
        writer.write_chunk(array, chunk, stored(store, layout, record), record.row);
        journal.chunk(record.array, record.index, writer.row(array, chunk));
        progress.advance(1);
    }
    return last.done;
}

void InterruptedRun::remove() const {
    std::error_code ignored;
    std::filesystem::remove(temporary_, ignored);
    std::filesystem::remove(centres_name(temporary_), ignored);
    std::filesystem::remove(journal_name(temporary_), ignored);
}

}  // namespace isonest::detail
