#include "tools/view/work_lane.h"

#include <utility>

#include "store/base/started_thread.h"

namespace isonest::detail::view {

WorkLane::WorkLane(std::size_t most_waiting)
    : most_waiting_(most_waiting), thread_(started_thread({}, [this] { run(); })) {}

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
        if (ended_ || entries_.size() >= most_waiting_) {
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
    for (;;) {
        changed_.wait(lock, [this] { return ended_ || !entries_.empty(); });
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
    }
}

}  // namespace isonest::detail::view
