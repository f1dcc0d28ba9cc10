// As oneTBB's header of this name, for one thread: a task runs when it is given.
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

/// An exception has ended the group before anybody could ask.
inline bool is_current_task_group_canceling() {
    return false;
}

}  // namespace tbb
