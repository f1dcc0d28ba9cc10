// Rows of numbers in temporary files, and on their way between ranks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Rows that are added one by one: up to 64 KiB in memory, more of them in a temporary file.
/// Thread-safety: none.
template <class Row>
class RowFile {
    static_assert(std::is_trivially_copyable_v<Row>);

  public:
    explicit RowFile(ScratchFolder folder) : folder_(std::move(folder)) {}

    /// Throws Error{io}.
    void add(const Row& row) {
        waiting_.push_back(row);
        if (waiting_.size() >= kWaiting) {
            flush();
        }
    }
    /// All rows, until the next call of another method; they may be changed. Throws Error{io}.
    std::span<Row> all() {
        if (!file_) {
            return waiting_;
        }
        flush();
        file_->map(count_ * sizeof(Row));
        return file_->template as<Row>().first(count_);
    }
    /// The first `count` ones stay.
    void shrink(std::uint64_t count) {
        if (file_) {
            flush();
            count_ = count;
        } else {
            waiting_.resize(count);
        }
    }
    /// Gives the space back.
    void clear() {
        waiting_ = {};
        file_.reset();
        count_ = 0;
    }

  private:
    static constexpr std::size_t kWaiting =
        std::max<std::size_t>(1, (std::size_t{1} << 16U) / sizeof(Row));
    void flush() {
        if (!waiting_.empty()) {
            if (!file_) {
                file_.emplace(folder_);
            }
            file_->write_at(count_ * sizeof(Row), std::as_bytes(std::span(waiting_)));
            count_ += waiting_.size();
            waiting_.clear();
        }
    }
    ScratchFolder folder_;
    std::optional<ScratchFile> file_;
    std::vector<Row> waiting_;
    std::uint64_t count_ = 0;  ///< in the file
};

/// Every rank tells every other one a number: returns those that this rank was told, by rank; its
/// own one as it is. Collective.
inline std::vector<std::uint64_t> told_by_all(Communicator& ranks,
                                              std::span<const std::uint64_t> to) {
    std::vector<std::uint64_t> told(to.begin(), to.end());
    int other = 0;
    ranks.exchange(
        [&](Communicator::Message& message) {
            other += other == ranks.rank() ? 1 : 0;
            if (other >= ranks.size()) {
                return false;
            }
            message.to = other;
            message.bytes.resize(sizeof(std::uint64_t));
            std::memcpy(message.bytes.data(), &to[static_cast<std::size_t>(other)],
                        sizeof(std::uint64_t));
            ++other;
            return true;
        },
        static_cast<std::uint64_t>(ranks.size()) - 1,
        [&](int from, std::span<const std::byte> bytes) {
            std::memcpy(&told[static_cast<std::size_t>(from)], bytes.data(), sizeof(std::uint64_t));
        });
    return told;
}

/// Rows for several ranks, this one among them. More than 1 MiB of them wait in temporary files;
/// they travel in messages of at most Communicator::kMostBytes. Thread-safety: none.
template <class Row>
class RowMail {
  public:
    explicit RowMail(const ScratchFolder& folder) : folder_(folder), addressed_(folder) {}

    /// Throws Error{io}.
    void add(int to, const Row& row) { addressed_.add({static_cast<std::uint32_t>(to), row}); }
    /// Hands all rows that ranks have added for this one to take(from, row): those of a rank in its
    /// order. Nothing waits any more. Collective. Throws Error{io, cancelled} and what `take`
    /// throws.
    template <class Take>
    void exchange(Communicator& ranks, const Take& take) {
        const auto size = static_cast<std::size_t>(ranks.size());
        const auto own = static_cast<std::size_t>(ranks.rank());
        std::vector<std::uint64_t> counts(size);
        const std::span<const Addressed> addressed = addressed_.all();
        for (const Addressed& a : addressed) {
            ++counts[a.to];
        }
        std::vector<std::uint64_t> first(size + 1);
        for (std::size_t to = 0; to < size; ++to) {
            first[to + 1] = first[to] + counts[to];
        }
        std::optional<ScratchFile> file;
        std::vector<Row> few;
        std::span<Row> rows;
        if (addressed.size() <= kRows) {
            few.resize(addressed.size());
            rows = few;
        } else {
            file.emplace(folder_);
            file->map(addressed.size() * sizeof(Row));
            rows = file->template as<Row>();
        }
        std::vector<std::uint64_t> at(first.begin(), first.end() - 1);
        for (const Addressed& a : addressed) {
            rows[at[a.to]++] = a.row;
        }
        addressed_.clear();
        const std::vector<std::uint64_t> told = told_by_all(ranks, counts);
        std::uint64_t expected = 0;
        for (std::size_t from = 0; from < size; ++from) {
            expected += from == own ? 0 : (told[from] + kRows - 1) / kRows;
        }
        for (const Row& row : rows.subspan(first[own], counts[own])) {
            take(ranks.rank(), row);
        }
        // Each rank begins with the one behind it, so that not all send to the same one.
        std::size_t step = 1;
        std::uint64_t sent = 0;  // of those for one rank
        ranks.exchange(
            [&](Communicator::Message& message) {
                while (step < size && sent == counts[(own + step) % size]) {
                    ++step;
                    sent = 0;
                }
                if (step >= size) {
                    return false;
                }
                const std::size_t to = (own + step) % size;
                const std::uint64_t here = std::min(kRows, counts[to] - sent);
                const auto bytes = std::as_bytes(rows.subspan(first[to] + sent, here));
                message.to = static_cast<int>(to);
                message.bytes.assign(bytes.begin(), bytes.end());
                sent += here;
                return true;
            },
            expected,
            [&](int from, std::span<const std::byte> bytes) {
                for (; !bytes.empty(); bytes = bytes.subspan(sizeof(Row))) {
                    Row row;
                    std::memcpy(&row, bytes.data(), sizeof(row));
                    take(from, row);
                }
            });
    }

  private:
    static constexpr std::uint64_t kRows = Communicator::kMostBytes / sizeof(Row);
    struct Addressed {
        std::uint32_t to = 0;
        Row row;
    };
    ScratchFolder folder_;
    RowFile<Addressed> addressed_;
};

}  // namespace isonest::detail
