// The thread that fetches ranges of one object: many at a time, again where that may help, and
// along redirects.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/remote/answer.h"
#include "store/remote/curl_request.h"
#include "store/remote/remote_options.h"
#include "store/remote/retry.h"

namespace isonest::detail {

/// Something to fetch. All its methods are called by the loop's thread; the last one is done() or
/// failed().
class FetchJob {
  public:
    FetchJob() = default;
    FetchJob(const FetchJob&) = delete;
    FetchJob& operator=(const FetchJob&) = delete;
    virtual ~FetchJob() = default;

    [[nodiscard]] virtual Asked asked() const = 0;
    /// Once: what comes is this, though it may come in several requests.
    virtual void begin(const AnswerHead& head, const ByteRange& range, std::uint64_t size) = 0;
    /// The next bytes of it.
    virtual void take(std::span<const std::byte> bytes) = 0;
    virtual void done() = 0;
    /// `is_change`: the object is another one now.
    virtual void failed(const Error& error, bool is_change) = 0;
};

struct RequestCounts {
    std::uint64_t bytes = 0;
    std::uint64_t requests = 0;
};

/// Thread-safety: wake() and counts() from any thread.
class FetchLoop {
  public:
    /// Null: nothing to do until the next wake(). Called by the loop's thread.
    using Next = std::function<std::shared_ptr<FetchJob>()>;

    /// Throws Error{unsupported} without libcurl.
    FetchLoop(RequestBasis basis, Next next);
    FetchLoop(const FetchLoop&) = delete;
    FetchLoop& operator=(const FetchLoop&) = delete;
    /// Ends all requests, as stop() does.
    ~FetchLoop();

    /// No request goes on, and no job hears anything any more.
    void stop();

    void wake();
    /// How the object was when it was opened: all later answers are compared with it. Called by the
    /// loop's thread, in FetchJob::begin().
    void set_opened(const Validators& opened) { opened_ = opened; }
    [[nodiscard]] RequestCounts counts() const { return {bytes_, requests_}; }

  private:
    using Clock = RetryState::Clock;

    /// A job that has been begun, and its request.
    struct Active {
        Active(std::shared_ptr<FetchJob> what, std::uint32_t seed)
            : job(std::move(what)), asked(job->asked()), retry(seed) {}
        std::shared_ptr<FetchJob> job;
        Asked asked;  ///< what has not come yet
        std::unique_ptr<CurlRequest> request = nullptr;
        std::string url = {};
        RetryState retry;
        int redirects = 0;
        bool has_begun = false;
        bool tried_origin = false;   ///< the place of an earlier redirect refused it
        bool is_waiting = false;     ///< until `at`, to be sent again
        Clock::time_point at = {};   ///< waiting: when it is sent; else the begin of the slow time
        std::uint64_t at_start = 0;  ///< bytes of this request at `at`
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
    void fail_or_retry(Active& active, Failure failure);
    void give_up(Active& active, const Failure& failure);
    void finish_with(Active& active, const std::function<void()>& tell);
    void detach(Active& active);
    [[nodiscard]] bool is_own(const std::string& url) const;

    RequestBasis basis_;
    Next next_;
    std::string origin_;
    CURLM* multi_ = nullptr;
    std::optional<Validators> opened_;
    std::string target_;  ///< where the last redirects led
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
