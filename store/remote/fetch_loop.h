// The thread that fetches ranges of one object, or many objects below one URL: many at a time,
// again where that may help, and along redirects.
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

/// An object of the loop's server. Only the loop's thread uses what is not const.
struct FetchObject {
    const std::string name;     ///< for messages
    const std::string request;  ///< http(s)://host[:port]/path[?query]
    /// How it was when it was opened, which goes along with requests from then on; nothing: it is
    /// taken as it is.
    std::optional<Validators> opened = std::nullopt;
    std::string target = request;  ///< where the last redirects led
};

/// Something to fetch. All its methods are called by the loop's thread; the last one is done() or
/// failed().
class FetchJob {
  public:
    FetchJob() = default;
    FetchJob(const FetchJob&) = delete;
    FetchJob& operator=(const FetchJob&) = delete;
    virtual ~FetchJob() = default;

    /// It lives as long as the job.
    [[nodiscard]] virtual FetchObject& object() const = 0;
    [[nodiscard]] virtual Asked asked() const = 0;
    /// Once: what comes is this, though it may come in several requests. Of a whole object once for
    /// each request: what came before is void, and where the server does not say its `size`, this
    /// is the largest that it can have.
    virtual void begin(const AnswerHead& head, const ByteRange& range, std::uint64_t size) = 0;
    /// The next bytes of it.
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
    [[nodiscard]] RequestCounts counts() const { return {bytes_, requests_}; }

  private:
    using Clock = RetryState::Clock;

    /// A job that has been begun, and its request.
    struct Active {
        Active(std::shared_ptr<FetchJob> what, std::uint32_t seed)
            : job(std::move(what)), object(job->object()), asked(job->asked()), retry(seed) {}
        std::shared_ptr<FetchJob> job;
        FetchObject& object;
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
