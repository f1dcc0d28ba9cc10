#include "store/remote/background.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <utility>

#include "store/base/started_thread.h"

namespace isonest::detail {

Background::Background(std::uint64_t most_bytes, const std::string& name)
    : most_bytes_(most_bytes), thread_(started_thread(name, [this] { run(); })) {}

Background::~Background() {
    finish(std::chrono::milliseconds(0));
}

bool Background::add(std::uint64_t bytes, std::function<void()> work) {
    const std::lock_guard lock(mutex_);
    if (ends_ || (bytes_ > 0 && bytes > most_bytes_ - std::min(bytes_, most_bytes_))) {
        return false;
    }
    entries_.push_back({bytes, std::move(work)});
    bytes_ += bytes;
    changed_.notify_all();
    return true;
}

void Background::finish(std::chrono::milliseconds at_most,
                        const std::function<bool()>& is_stopped) {
    constexpr std::chrono::milliseconds kStep{50};
    using Clock = std::chrono::steady_clock;
    const Clock::time_point last = Clock::now() + at_most;
    std::deque<Entry> left;
    {
        std::unique_lock lock(mutex_);
        const auto is_done = [this] { return entries_.empty() && !is_working_; };
        while (!changed_.wait_until(lock, std::min(last, Clock::now() + kStep), is_done) &&
               Clock::now() < last) {
            lock.unlock();
            const bool stops = is_stopped && is_stopped();
            lock.lock();
            if (stops) {
                break;
            }
        }
        ends_ = true;
        left.swap(entries_);
    }
    changed_.notify_all();
    if (thread_.joinable()) {
        thread_.join();
    }
}

void Background::run() {
    // Signals are for the threads of the program.
    sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, nullptr);
    std::unique_lock lock(mutex_);
    while (true) {
        changed_.wait(lock, [this] { return ends_ || !entries_.empty(); });
        if (ends_) {
            return;
        }
        Entry entry = std::move(entries_.front());
        entries_.pop_front();
        is_working_ = true;
        lock.unlock();
        try {
            entry.work();
        } catch (...) {  // NOLINT(bugprone-empty-catch): nobody waits for it
        }
        entry.work = nullptr;
        lock.lock();
        bytes_ -= entry.bytes;
        is_working_ = false;
        changed_.notify_all();
    }
}

}  // namespace isonest::detail
