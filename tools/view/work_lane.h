// Work on its own thread, one job after the other; each can be cancelled. Freed memory is returned
// to the system when the thread becomes idle.
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

/// A job and its cancellation flag, which all long work checks.
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
    explicit WorkLane(std::size_t max_waiting);
    WorkLane(const WorkLane&) = delete;
    WorkLane& operator=(const WorkLane&) = delete;
    /// Cancels everything and waits for the current job; by then, every `work` has been called.
    ~WorkLane();

    /// `work` is called once with the job, even if it was cancelled while it waited; it must not
    /// throw. Returns false and does nothing if too many jobs are waiting.
    bool add(std::shared_ptr<Job> job, std::function<void(Job&)> work);
    [[nodiscard]] std::size_t waiting() const;
    [[nodiscard]] bool busy() const { return busy_; }

  private:
    void run();

    struct Entry {
        std::shared_ptr<Job> job;
        std::function<void(Job&)> work;
    };
    const std::size_t max_waiting_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Entry> entries_;
    std::shared_ptr<Job> current_;
    bool ended_ = false;
    std::atomic<bool> busy_ = false;
    std::thread thread_;
};

}  // namespace isonest::detail::view
