#include "tools/python/src/progress.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include <isonest/error.h>

namespace isonest::python {
namespace {

constexpr auto kPeriod = std::chrono::milliseconds(100);

struct Phase {
    std::string name;
    std::string unit;
    std::uint64_t total = 0;
    std::uint64_t done = 0;
};

class WatchedProgress;

/// The work that is running, started by any thread of Python.
struct Running {
    std::mutex mutex;
    std::set<const WatchedProgress*> all;
};

Running& running() {
    static Running instance;
    return instance;
}

/// Records the progress of the work, for a thread that polls it.
class WatchedProgress : public Progress {
  public:
    WatchedProgress() {
        const std::lock_guard lock(running().mutex);
        running().all.insert(this);
    }
    WatchedProgress(const WatchedProgress&) = delete;
    WatchedProgress& operator=(const WatchedProgress&) = delete;
    ~WatchedProgress() override {
        const std::lock_guard lock(running().mutex);
        running().all.erase(this);
    }
    void begin(std::string_view phase, std::uint64_t total, std::string_view unit) override {
        const std::lock_guard lock(mutex_);
        const std::uint64_t done = done_.exchange(0);
        if (!phases_.empty()) {
            phases_.back().done = done;
        }
        phases_.push_back({std::string(phase), std::string(unit), total});
    }
    void advance(std::uint64_t amount) override {
        done_.fetch_add(amount, std::memory_order_relaxed);
    }
    [[nodiscard]] bool cancelled() const override {
        return cancelled_.load(std::memory_order_relaxed);
    }
    void cancel() { cancelled_ = true; }

    /// The phase that was current at the last call, and those that have begun since.
    std::vector<Phase> news() {
        const std::lock_guard lock(mutex_);
        if (phases_.empty()) {
            return {};
        }
        phases_.back().done = done_.load();
        std::vector<Phase> all{phases_.back()};
        all.swap(phases_);
        return all;
    }

  private:
    std::mutex mutex_;
    std::vector<Phase> phases_;
    std::atomic<std::uint64_t> done_{0};
    std::atomic<bool> cancelled_{false};
};

/// Calls `function` with new progress. REQUIRES: the GIL is held.
class Reporter {
  public:
    Reporter(WatchedProgress& progress, const py::object& function)
        : progress_(progress), function_(function) {}
    void report() {
        const std::vector<Phase> news = progress_.news();
        if (function_.is_none()) {
            return;
        }
        bool is_known = is_first_known_;
        for (const Phase& phase : news) {
            if (!is_known || phase.done > said_) {
                function_(phase.name, phase.done, phase.total, phase.unit);
            }
            said_ = phase.done;
            is_known = false;
            is_first_known_ = true;
        }
    }

  private:
    WatchedProgress& progress_;
    const py::object& function_;
    bool is_first_known_ = false;
    std::uint64_t said_ = 0;
};

/// Runs the work on its own thread.
class Worker {
  public:
    Worker(WatchedProgress& progress, const std::function<void(Progress&)>& work)
        : thread_([this, &progress, &work] {
              try {
                  work(progress);
              } catch (...) {
                  failure_ = std::current_exception();
              }
              const std::lock_guard lock(mutex_);
              ended_ = true;
              changed_.notify_one();
          }) {}
    ~Worker() { join(); }
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    /// Waits until the work has ended, for at most one period.
    bool ended() {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, kPeriod, [this] { return ended_; });
    }
    void join() {
        if (thread_.joinable()) {
            thread_.join();
        }
    }
    [[nodiscard]] std::exception_ptr failure() const { return failure_; }

  private:
    std::mutex mutex_;
    std::condition_variable changed_;
    bool ended_ = false;
    std::exception_ptr failure_;
    std::thread thread_;
};

}  // namespace

void check_running() {
    const std::lock_guard lock(running().mutex);
    const auto& all = running().all;
    if (!all.empty() && std::all_of(all.begin(), all.end(), [](const WatchedProgress* progress) {
            return progress->cancelled();
        })) {
        (*all.begin())->check();
    }
}

void run_watched(const py::object& report, const std::function<void(Progress&)>& work) {
    WatchedProgress progress;
    Reporter reporter(progress, report);
    std::exception_ptr raised;
    std::exception_ptr failure;
    const auto watch = [&] {
        if (raised) {
            return;
        }
        try {
            if (PyErr_CheckSignals() != 0) {
                throw py::error_already_set();
            }
            reporter.report();
        } catch (...) {
            raised = std::current_exception();
            progress.cancel();
        }
    };
    try {
        const py::gil_scoped_release without;
        Worker worker(progress, work);
        while (!worker.ended()) {
            const py::gil_scoped_acquire with;
            watch();
        }
        worker.join();
        failure = worker.failure();
    } catch (const std::system_error&) {
        throw Error(ErrorKind::limit, "the system cannot start a thread",
                    {{RemedyKind::raise_limit, "ulimit -u"}});
    }
    if (!failure) {
        watch();
    }
    if (raised) {
        std::rethrow_exception(raised);
    }
    if (failure) {
        std::rethrow_exception(failure);
    }
}

}  // namespace isonest::python
