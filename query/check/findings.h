// What a check has found so far, from all threads.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "query/check/check.h"

namespace isonest::detail {

inline constexpr Int3 kWholeChunk{-1, -1, -1};

/// Keeps the first findings in the order of the tests, arrays, chunks and nodes, whichever thread
/// comes first. Thread-safety: all methods from any thread, take() from one.
class Findings {
  public:
    /// `chunks`: rows of the store's chunk table.
    explicit Findings(std::uint64_t chunks) : damaged_(chunks) {}

    /// `test`: one of those that Finding names.
    void add(const char* test, const ArrayInfo& array, const Int3& chunk, const Int3& node,
             const std::string& message);
    /// The same, but only the first time for this chunk, which counts as damaged from then on.
    void add_damaged(const char* test, const ArrayInfo& array, const Int3& chunk,
                     const std::string& message);
    [[nodiscard]] bool is_damaged(const ArrayInfo& array, const Int3& chunk);
    [[nodiscard]] bool any_damaged();
    /// Some chunk is damaged that others have found.
    void note_damage();
    /// Rank 0 has those of all then. Collective. Throws Error{cancelled}.
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
