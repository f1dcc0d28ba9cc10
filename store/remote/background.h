// A thread for work that nobody waits for.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace isonest::detail {

/// Does what it is given, one after the other. Thread-safety: add() from any thread.
class Background {
  public:
    /// `most_bytes`: of all work that waits or is under way, unless it is a single piece. `name`:
    /// for the error. Throws Error{limit} if the system lets no thread start.
    Background(std::uint64_t most_bytes, const std::string& name);
    Background(const Background&) = delete;
    Background& operator=(const Background&) = delete;
    /// As finish() without waiting for what has not been begun.
    ~Background();

    /// False, and the work is let go at once, if it would be too much with what waits, or after
    /// finish(). What the work throws is lost.
    bool add(std::uint64_t bytes, std::function<void()> work);
    /// Waits until all of it is done, or for so long, or until is_stopped() is true, which is asked
    /// every 50 ms; then for what is under way alone.
    void finish(std::chrono::milliseconds at_most, const std::function<bool()>& is_stopped = {});

  private:
    void run();

    struct Entry {
        std::uint64_t bytes = 0;
        std::function<void()> work;
    };
    const std::uint64_t most_bytes_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Entry> entries_;
    std::uint64_t bytes_ = 0;  ///< of what waits or is under way
    bool is_working_ = false;
    bool ends_ = false;
    std::thread thread_;
};

}  // namespace isonest::detail
