// Single-threaded replacement for oneTBB's header of this name.
#pragma once

namespace tbb {

class task_arena {
  public:
    task_arena() = default;
    explicit task_arena(int /*threads*/) {}
    void initialize(int /*threads*/) {}
    template <class Work>
    auto execute(const Work& work) {
        return work();
    }
};

namespace this_task_arena {

inline int max_concurrency() {
    return 1;
}

inline int current_thread_index() {
    return 0;
}

template <class Work>
auto isolate(const Work& work) {
    return work();
}

}  // namespace this_task_arena

}  // namespace tbb
