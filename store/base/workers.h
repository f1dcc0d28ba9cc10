// The threads that one call may use, and resources that the system may refuse: threads, libraries.
#pragma once

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/task_arena.h>

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

namespace isonest::detail {

// A thread that the system may refuse to start.

/// Runs `work` in its own thread. Throws Error{limit}, with `name` as its file, if the system
/// refuses to start a thread.
std::thread started_thread(const std::string& name, std::function<void()> work);

// Why a library could not be loaded.

/// To be called after dlopen() of a library failed. why: the text of dlerror(). Throws
/// Error{limit}, with `file` as its file, if there was no memory or no free descriptor: the library
/// may then be installed. whole: the library's name for the beginning of the message, "libOSMesa".
void throw_if_no_room_to_load(const std::string& file, const std::string& whole,
                              std::string_view why);

/// Throws Error{limit} if the system does not let this process start `count` - 1 more threads.
/// oneTBB would notice this in the middle of the work, when it can only end the program.
void require_threads(int count);

/// Makes oneTBB start the threads of the arena now if the address space or data size of this
/// process is limited. oneTBB ends the program if a thread does not start, which happens once the
/// work has taken the memory that require_threads() found available.
void start_threads_where_memory_is_limited(tbb::task_arena& arena, int count);

/// `threads` workers, even if the machine has fewer processors; 0 = one per processor. Throws
/// Error{limit} if the system refuses them.
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
