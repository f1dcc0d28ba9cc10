#include "preprocess/levels/run_journal.h"

#include <cstddef>

#include "store/container/codec.h"

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
    // Where locks are refused (some network file systems) the process id in the name has to do.
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

}  // namespace isonest::detail
