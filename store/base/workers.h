// The threads that one call may use.
#pragma once

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/task_arena.h>

#include <optional>

namespace isonest::detail {

/// Throws Error{limit} if the system does not let this process start `count` - 1 more threads.
/// oneTBB would find out in the middle of the work, where it can only end the program.
void require_threads(int count);

/// Lets oneTBB start the threads of the arena now, where the address space or the data of this
/// process are limited: it ends the program when a thread does not start, which happens once the
/// work has taken the memory that was there for require_threads().
void start_threads_where_memory_is_limited(tbb::task_arena& arena, int count);

/// `threads` workers, also where that is more than the machine has; 0 = as many as it has.
/// Throws Error{limit} if the system refuses them.
class Workers {
  public:
    explicit Workers(int threads) : count_(count_of(threads)) {
        require_threads(count_);
        if (count_ > tbb::info::default_concurrency()) {
            allowed_.emplace(tbb::global_control::max_allowed_parallelism,
                             static_cast<std::size_t>(count_));
        }
        arena_.initialize(count_);
        start_threads_where_memory_is_limited(arena_, count_);
    }
    [[nodiscard]] static int count_of(int threads) {
        return threads > 0 ? threads : tbb::info::default_concurrency();
    }
    [[nodiscard]] int count() const { return count_; }
    template <class Work>
    auto execute(const Work& work) {
        return arena_.execute(work);
    }

  private:
    int count_;
    std::optional<tbb::global_control> allowed_;
    tbb::task_arena arena_;
};

}  // namespace isonest::detail
