// The thread that fetches ranges of one object, or many objects below one URL: many at a time, with
// retries and redirects.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/remote/answer.h"
#include "store/remote/curl_request.h"
#include "store/remote/object_url.h"

namespace isonest::detail {

// How a thread waits for data from the network.

/// Throws a copy, so that each thread gets its own error.
[[noreturn]] inline void throw_copy_of(const Error& error) {
    throw Error(error.kind(), error.place(), error.problem(), error.remedies());
}

/// Waits until is_over(), which is called with the lock held. check() (RemoteOptions) is called
/// every 50 ms, without the lock. Throws what the two throw.
template <class IsOver>
void wait_and_check(std::unique_lock<std::mutex>& lock, std::condition_variable& changed,
                    const std::function<void()>& check, const IsOver& is_over) {
    constexpr std::chrono::milliseconds kCheckEvery{50};
    auto next_check = std::chrono::steady_clock::now() + kCheckEvery;
    while (!is_over()) {
        changed.wait_until(lock, next_check);
        if (std::chrono::steady_clock::now() >= next_check) {
            next_check = std::chrono::steady_clock::now() + kCheckEvery;
            if (check) {
                lock.unlock();
                check();
                lock.lock();
            }
        }
    }
}

// A thread for work that nobody waits for.

/// Executes the given work, one piece after the other. Thread-safety: add() from any thread.
class Background {
  public:
    /// `max_bytes`: limit for the work that waits or is under way, except for a single piece.
    /// `name`: for the error. Throws Error{limit} if the system refuses to start a thread.
    Background(std::uint64_t max_bytes, const std::string& name);
    Background(const Background&) = delete;
    Background& operator=(const Background&) = delete;
    /// Like finish(), but without waiting for work that has not started.
    ~Background();

    /// False if the work would exceed the limit together with the waiting work, or after finish();
    /// it is then discarded at once. Exceptions thrown by the work are lost.
    bool add(std::uint64_t bytes, std::function<void()> work);
    /// Waits until all work is done, or until the time is over, or is_stopped(), called every 50
    /// ms, returns true; in the last two cases it still waits for the work under way.
    void finish(std::chrono::milliseconds at_most, const std::function<bool()>& is_stopped = {});

  private:
    void run();

    struct Entry {
        std::uint64_t bytes = 0;
        std::function<void()> work;
    };
    const std::uint64_t max_bytes_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Entry> entries_;
    std::uint64_t bytes_ = 0;  ///< of work that waits or is under way
    bool is_working_ = false;
    bool ends_ = false;
    std::thread thread_;
};

/// An object of the loop's server. Non-const members are used only by the loop's thread.
struct FetchObject {
    const std::string name;     ///< for messages
    const std::string request;  ///< http(s)://host[:port]/path[?query]
    /// The state of the object when it was opened, which later requests refer to; nullopt: any
    /// state is accepted.
    std::optional<Validators> opened = std::nullopt;
    std::string target = request;  ///< target of the last redirects
};

/// Something to fetch. All methods are called by the loop's thread; the last call is done() or
/// failed().
class FetchJob {
  public:
    FetchJob() = default;
    FetchJob(const FetchJob&) = delete;
    FetchJob& operator=(const FetchJob&) = delete;
    virtual ~FetchJob() = default;

    /// Lives as long as the job.
    [[nodiscard]] virtual FetchObject& object() const = 0;
    [[nodiscard]] virtual Asked asked() const = 0;
    /// Called once with the range that is coming, possibly in several requests. For a whole object,
    /// called for each request: earlier bytes are then void, and if the server does not report the
    /// `size`, it is the maximum that is possible.
    virtual void begin(const AnswerHead& head, const ByteRange& range, std::uint64_t size) = 0;
    /// The next bytes.
    virtual void take(std::span<const std::byte> bytes) = 0;
    virtual void done() = 0;
    virtual void failed(const Error& error, const Failure& failure) = 0;
};

struct RequestCounts {
    std::uint64_t bytes = 0;
    std::uint64_t requests = 0;
};

/// Thread-safety: wake() and counts() from any thread.
class FetchLoop {
  public:
    /// Returns null if there is nothing to do until the next wake(). Called by the loop's thread.
    using Next = std::function<std::shared_ptr<FetchJob>()>;

    /// Throws Error{unsupported} without libcurl.
    FetchLoop(RequestBasis basis, Next next);
    FetchLoop(const FetchLoop&) = delete;
    FetchLoop& operator=(const FetchLoop&) = delete;
    /// Aborts all requests, like stop().
    ~FetchLoop();

    /// Aborts all requests; no job is called any more.
    void stop();

    void wake();
    [[nodiscard]] RequestCounts counts() const { return {bytes_, requests_}; }

  private:
    using Clock = RetryState::Clock;

    /// A job that has been started, and its request.
    struct Active {
        Active(std::shared_ptr<FetchJob> what, std::uint32_t seed)
            : job(std::move(what)), object(job->object()), asked(job->asked()), retry(seed) {}
        std::shared_ptr<FetchJob> job;
        FetchObject& object;
        Asked asked;  ///< what has not arrived yet
        std::unique_ptr<CurlRequest> request = nullptr;
        std::string url = {};
        RetryState retry;
        int redirects = 0;
        bool has_begun = false;
        bool tried_origin = false;   ///< the target of an earlier redirect refused the request
        bool is_waiting = false;     ///< to be sent again at `at`
        Clock::time_point at = {};   ///< waiting: time of sending; else the start of the slow time
        std::uint64_t at_start = 0;  ///< bytes of this request at time `at`
    };

    void run();
    void take_new_jobs();
    void send(Active& active);
    void read_messages();
    void look_at_the_clock();
    [[nodiscard]] std::chrono::milliseconds until_next_event() const;
    void end_request(Active& active, CURLcode code);
    void follow(Active& active, const CurlRequest::Outcome& outcome);
    void ask_for_the_end(Active& active, std::uint64_t size);
    void fail_or_retry(Active& active, const Failure& failure);
    void give_up(Active& active, const Failure& failure);
    void finish_with(Active& active, const std::function<void()>& tell);
    void detach(Active& active);
    [[nodiscard]] bool is_own(const std::string& url) const;

    RequestBasis basis_;
    Next next_;
    std::string origin_;
    CURLM* multi_ = nullptr;
    std::optional<Clock::time_point> pause_until_;
    std::vector<std::unique_ptr<Active>> active_;
    std::vector<std::unique_ptr<CurlRequest>> idle_;
    std::uint32_t seed_ = 0;
    std::atomic<std::uint64_t> bytes_{0};
    std::atomic<std::uint64_t> requests_{0};
    std::atomic<bool> stops_{false};
    std::thread thread_;
};

}  // namespace isonest::detail
