// The findings of a check so far, from all threads.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "query/check/check.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

// The share of a check that one rank does.

/// A range of a sequence: all, or one rank's.
struct RankShare {
    Communicator* ranks = nullptr;  ///< null: one process does all

    [[nodiscard]] std::int64_t size() const { return ranks != nullptr ? ranks->size() : 1; }
    [[nodiscard]] bool is_first() const { return ranks == nullptr || ranks->rank() == 0; }
    /// This rank's range of `count` items: first and end.
    [[nodiscard]] std::pair<std::int64_t, std::int64_t> of(std::int64_t count) const {
        const std::int64_t rank = ranks != nullptr ? ranks->rank() : 0;
        return {count * rank / size(), count * (rank + 1) / size()};
    }
    /// Whether it is true on any rank. Collective.
    [[nodiscard]] bool any(bool holds) const {
        std::uint64_t sum = holds ? 1 : 0;
        if (ranks != nullptr) {
            ranks->sum({&sum, 1});
        }
        return sum > 0;
    }
};

inline constexpr Int3 kWholeChunk{-1, -1, -1};

/// Keeps the first findings in the order of tests, arrays, chunks and nodes, independent of the
/// order of threads. Thread-safety: all methods from any thread, take() from one.
class Findings {
  public:
    /// `chunks`: number of rows of the store's chunk table.
    explicit Findings(std::uint64_t chunks) : damaged_(chunks) {}

    /// `test`: one of the names at Finding.
    void add(const char* test, const ArrayInfo& array, const Int3& chunk, const Int3& node,
             const std::string& message);
    /// The same, but only the first time for this chunk; afterwards it counts as damaged.
    void add_damaged(const char* test, const ArrayInfo& array, const Int3& chunk,
                     const std::string& message);
    [[nodiscard]] bool is_damaged(const ArrayInfo& array, const Int3& chunk);
    [[nodiscard]] bool any_damaged();
    /// Records that other ranks have found a damaged chunk.
    void note_damage();
    /// Collects all findings on rank 0. Collective. Throws Error{cancelled}.
    void gather(Communicator& ranks);
    void count(std::int64_t nodes, std::uint64_t chunks = 0, std::uint64_t cubes = 0);
    [[nodiscard]] CheckReport take();

  private:
    struct Entry {
        std::size_t test = 0;
        std::uint64_t row = 0;
        Finding finding;
        [[nodiscard]] bool operator<(const Entry& other) const;
    };
    void insert(Entry entry);
    std::mutex mutex_;
    std::vector<bool> damaged_;  ///< one bit for each 40 bytes of the table
    bool any_damaged_ = false;
    std::vector<Entry> first_;  ///< sorted
    CheckReport report_;
};

}  // namespace isonest::detail
