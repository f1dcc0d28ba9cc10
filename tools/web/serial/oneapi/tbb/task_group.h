// Single-threaded replacement for oneTBB's header of this name: a task runs when it is submitted.
#pragma once

namespace tbb {

class task_group {
  public:
    template <class Task>
    void run(const Task& task) {
        task();
    }
    void wait() {}
};

/// Always false: an exception ends the group before this could be called.
inline bool is_current_task_group_canceling() {
    return false;
}

}  // namespace tbb
