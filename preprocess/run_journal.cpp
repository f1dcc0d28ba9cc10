#include "preprocess/run_journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "store/codec.h"
#include "store/error.h"

namespace isonest {
namespace {

constexpr std::size_t kPending = 1024;

void write_all(int fd, std::span<const std::byte> bytes, const std::filesystem::path& path) {
    while (!bytes.empty()) {
        const ssize_t n = ::write(fd, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            throw Error(ErrorKind::io, fmt::format("{}: cannot write: {}", path.string(),
                                                   std::strerror(n == 0 ? ENOSPC : errno)));
        }
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
}

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
    : path_(journal_name(temporary)) {
    ::unlink(path_.c_str());
    fd_ = ::open(path_.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (fd_ < 0) {
        throw Error(ErrorKind::io,
                    fmt::format("{}: cannot create: {}", path_.string(), std::strerror(errno)));
    }
    // Where locks are refused (some network file systems) the process id in the name has to do.
    ::flock(fd_, LOCK_EX | LOCK_NB);
    try {
        const std::uint64_t size = identity.size();
        const auto text = std::as_bytes(std::span(identity));
        write_all(fd_, bytes_of(size), path_);
        write_all(fd_, text, path_);
        write_all(fd_, bytes_of(checksum_of(text)), path_);
    } catch (...) {
        ::close(fd_);
        ::unlink(path_.c_str());
        throw;
    }
    pending_.reserve(kPending);
}

RunJournal::~RunJournal() {
    if (keep_) {
        try {
            flush();
        } catch (...) {
            // What is on disk is valid up to its last whole record.
        }
    } else {
        ::unlink(path_.c_str());
    }
    ::close(fd_);
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
    append(record);
    flush();
    ++checkpoints_;
}

void RunJournal::flush() {
    write_all(fd_, std::as_bytes(std::span(pending_)), path_);
    pending_.clear();
}

}  // namespace isonest
