// What a check has found so far, from all threads.
#pragma once

#include <mutex>
#include <set>

#include "query/check.h"

namespace isonest {

inline constexpr Int3 kWholeChunk{-1, -1, -1};

/// Thread-safety: all methods from any thread, take() from one.
class Findings {
  public:
    void add(const char* test, const ArrayInfo& array, const Int3& chunk, const Int3& node,
             const std::string& message) {
        const std::lock_guard lock(mutex_);
        ++report_.failures;
        if (report_.findings.size() < kMostFindings) {
            report_.findings.push_back(
                {test, std::string(name_of(array.field)), array.level, chunk, node, message});
        }
    }
    /// The same, but only the first time for this chunk, which counts as damaged from then on.
    void add_damaged(const char* test, const ArrayInfo& array, const Int3& chunk,
                     const std::string& message) {
        {
            const std::lock_guard lock(mutex_);
            if (!damaged_.insert(array.row_of(chunk)).second) {
                return;
            }
        }
        add(test, array, chunk, kWholeChunk, message);
    }
    [[nodiscard]] bool is_damaged(const ArrayInfo& array, const Int3& chunk) {
        const std::lock_guard lock(mutex_);
        return damaged_.contains(array.row_of(chunk));
    }
    [[nodiscard]] bool any_damaged() {
        const std::lock_guard lock(mutex_);
        return !damaged_.empty();
    }
    void count(std::int64_t nodes, std::uint64_t chunks = 0, std::uint64_t cubes = 0) {
        const std::lock_guard lock(mutex_);
        report_.nodes += static_cast<std::uint64_t>(nodes);
        report_.chunks += chunks;
        report_.cubes += cubes;
    }
    [[nodiscard]] CheckReport take() { return std::move(report_); }

  private:
    static constexpr std::size_t kMostFindings = 100;
    std::mutex mutex_;
    std::set<std::uint64_t> damaged_;
    CheckReport report_;
};

}  // namespace isonest
