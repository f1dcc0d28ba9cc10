// Work in a thread of its own, one piece after the other, each of which can be cancelled. What it
// freed is returned to the system when it has paused.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include <isonest/progress.h>

#include "tools/view/http_messages.h"

namespace isonest::detail::view {

/// A piece of work and what it is told to do: all long work asks whether it is cancelled.
class Job : public Progress, public Waiting {
  public:
    void cancel() override { cancelled_ = true; }
    [[nodiscard]] bool cancelled() const override { return cancelled_; }

  private:
    std::atomic<bool> cancelled_ = false;
};

/// Thread-safe.
class WorkLane {
  public:
    explicit WorkLane(std::size_t most_waiting);
    WorkLane(const WorkLane&) = delete;
    WorkLane& operator=(const WorkLane&) = delete;
    /// Cancels everything and waits for what is under way; each `work` has been called then.
    ~WorkLane();

    /// `work` is called once with the job, also if that was cancelled while it waited; it must not
    /// throw. False, and nothing happens, if too many wait already.
    bool add(std::shared_ptr<Job> job, std::function<void(Job&)> work);
    [[nodiscard]] std::size_t waiting() const;
    [[nodiscard]] bool busy() const { return busy_; }

  private:
    void run();

    struct Entry {
        std::shared_ptr<Job> job;
        std::function<void(Job&)> work;
    };
    const std::size_t most_waiting_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Entry> entries_;
    std::shared_ptr<Job> current_;
    bool ended_ = false;
    std::atomic<bool> busy_ = false;
    std::thread thread_;
};

}  // namespace isonest::detail::view
