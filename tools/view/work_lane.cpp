#include "tools/view/work_lane.h"

#include <malloc.h>

#include <chrono>
#include <utility>

#include "store/base/workers.h"

namespace isonest::detail::view {

namespace {

using Clock = std::chrono::steady_clock;

// The allocator keeps freed memory for later work. A server runs for long, so it returns that
// memory when it is idle, and from time to time while it is busy.
constexpr auto kPause = std::chrono::seconds(2);
constexpr auto kKeptFor = std::chrono::seconds(10);

}  // namespace

WorkLane::WorkLane(std::size_t max_waiting)
    : max_waiting_(max_waiting), thread_(started_thread({}, [this] { run(); })) {}

WorkLane::~WorkLane() {
    {
        const std::lock_guard lock(mutex_);
        ended_ = true;
        for (const Entry& entry : entries_) {
            entry.job->cancel();
        }
        if (current_) {
            current_->cancel();
        }
    }
    changed_.notify_all();
    thread_.join();
}

bool WorkLane::add(std::shared_ptr<Job> job, std::function<void(Job&)> work) {
    {
        const std::lock_guard lock(mutex_);
        if (ended_ || entries_.size() >= max_waiting_) {
            return false;
        }
        entries_.push_back({std::move(job), std::move(work)});
    }
    changed_.notify_all();
    return true;
}

std::size_t WorkLane::waiting() const {
    const std::lock_guard lock(mutex_);
    return entries_.size();
}

void WorkLane::run() {
    std::unique_lock lock(mutex_);
    const auto is_called = [this] { return ended_ || !entries_.empty(); };
    Clock::time_point returned = Clock::now();
    const auto return_memory = [&] {
        lock.unlock();
        ::malloc_trim(0);
        returned = Clock::now();
        lock.lock();
    };
    for (;;) {
        changed_.wait(lock, is_called);
        if (entries_.empty()) {
            return;
        }
        Entry entry = std::move(entries_.front());
        entries_.pop_front();
        current_ = entry.job;
        busy_ = true;
        lock.unlock();
        entry.work(*entry.job);
        entry = {};
        lock.lock();
        current_.reset();
        busy_ = false;
        if (Clock::now() - returned > kKeptFor) {
            return_memory();
        }
        if (!changed_.wait_for(lock, kPause, is_called)) {
            return_memory();
        }
    }
}

}  // namespace isonest::detail::view
