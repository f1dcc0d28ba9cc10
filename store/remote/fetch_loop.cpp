#include "store/remote/fetch_loop.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <exception>
#include <new>
#include <random>
#include <utility>

#include <isonest/error.h>

#include "store/base/workers.h"

namespace isonest::detail {

Background::Background(std::uint64_t max_bytes, const std::string& name)
    : max_bytes_(max_bytes), thread_(started_thread(name, [this] { run(); })) {}

Background::~Background() {
    finish(std::chrono::milliseconds(0));
}

bool Background::add(std::uint64_t bytes, std::function<void()> work) {
    const std::lock_guard lock(mutex_);
    if (ends_ || (bytes_ > 0 && bytes > max_bytes_ - std::min(bytes_, max_bytes_))) {
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
    // Signals are handled by the program's own threads.
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

namespace {

constexpr int kMaxRedirects = 5;
/// Progress after which earlier failures of a range no longer count.
constexpr std::uint64_t kMuch = 64U << 10U;
constexpr std::chrono::milliseconds kLongSleep{60'000};
/// Time after which memory may be free again.
constexpr std::chrono::milliseconds kMemoryPause{100};

bool is_https(const std::string& url) {
    return url.starts_with("https://");
}

Failure failure_of_exception() {
    try {
        throw;
    } catch (const std::bad_alloc&) {
        return failure_of_transfer(CURLE_OUT_OF_MEMORY, "");
    } catch (const std::exception& error) {
        return {FailureClass::final, error.what()};
    }
}

}  // namespace

FetchLoop::FetchLoop(RequestBasis basis, Next next)
    : basis_(std::move(basis)),
      next_(std::move(next)),
      origin_(origin_of(basis_.url.request)),
      seed_(std::random_device{}()) {
    multi_ = curl().curl_multi_init();
    if (multi_ == nullptr) {
        throw std::bad_alloc();
    }
    const auto parallel = static_cast<long>(basis_.options.parallel_requests);
    curl().curl_multi_setopt(multi_, CURLMOPT_MAX_HOST_CONNECTIONS, parallel);
    curl().curl_multi_setopt(multi_, CURLMOPT_MAXCONNECTS, parallel);
    try {
        thread_ = started_thread(basis_.url.name, [this] { run(); });
    } catch (const Error&) {
        curl().curl_multi_cleanup(multi_);
        throw;
    }
}

void FetchLoop::stop() {
    stops_ = true;
    wake();
    if (thread_.joinable()) {
        thread_.join();
    }
}

FetchLoop::~FetchLoop() {
    stop();
    for (const auto& active : active_) {
        detach(*active);
    }
    active_.clear();
    idle_.clear();
    curl().curl_multi_cleanup(multi_);
}

void FetchLoop::wake() {
    curl().curl_multi_wakeup(multi_);
}

bool FetchLoop::is_own(const std::string& url) const {
    return origin_of(url) == origin_;
}

void FetchLoop::run() {
    // Block all signals: they are for the program's own threads, and SIGPIPE of a broken
    // connection is for none.
    sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, nullptr);
    while (!stops_) {
        int running = 0;
        curl().curl_multi_perform(multi_, &running);
        read_messages();
        look_at_the_clock();
        active_.erase(std::remove_if(active_.begin(), active_.end(),
                                     [](const auto& active) { return active->job == nullptr; }),
                      active_.end());
        take_new_jobs();
        if (!stops_) {
            curl().curl_multi_poll(multi_, nullptr, 0, static_cast<int>(until_next_event().count()),
                                   nullptr);
        }
    }
}

void FetchLoop::take_new_jobs() {
    if (pause_until_) {
        if (Clock::now() < *pause_until_) {
            return;
        }
        pause_until_.reset();
    }
    const int most = basis_.waits_for_stream ? basis_.options.parallel_streams
                                             : basis_.options.parallel_requests;
    while (active_.size() < static_cast<std::size_t>(most)) {
        std::shared_ptr<FetchJob> job;
        try {
            job = next_();
        } catch (const std::bad_alloc&) {
            pause_until_ = Clock::now() + kMemoryPause;
            return;
        }
        if (job == nullptr) {
            return;
        }
        active_.push_back(std::make_unique<Active>(std::move(job), seed_++));
        send(*active_.back());
    }
}

void FetchLoop::send(Active& active) {
    active.is_waiting = false;
    if (active.redirects == 0) {
        active.url = active.tried_origin ? active.object.request : active.object.target;
    }
    try {
        if (active.request == nullptr) {
            if (idle_.empty()) {
                active.request = std::make_unique<CurlRequest>();
            } else {
                active.request = std::move(idle_.back());
                idle_.pop_back();
            }
        }
        CurlRequest::Plan plan;
        plan.url = active.url;
        plan.is_own_server = is_own(active.url);
        plan.asked = active.asked;
        plan.opened = active.object.opened ? &*active.object.opened : nullptr;
        plan.begin = [&active](const AnswerHead& head, const Judgement& judgement) {
            if (active.asked.is_whole) {
                active.job->begin(head, judgement.range, judgement.size);
            } else if (!active.has_begun) {
                // A server may send less than the requested range, except for a range at the end.
                const ByteRange range =
                    active.asked.tail != 0 ? judgement.range : active.asked.range;
                active.has_begun = true;
                active.asked = {.range = range};
                active.job->begin(head, range, judgement.size);
            }
        };
        plan.take = [&active](std::span<const std::byte> bytes) {
            active.job->take(bytes);
            if (active.asked.is_whole) {
                return;
            }
            active.asked.range.offset += bytes.size();
            active.asked.range.size -= bytes.size();
        };
        plan.body_bytes = &bytes_;
        active.request->prepare(basis_, std::move(plan));
    } catch (...) {
        give_up(active, failure_of_exception());
        return;
    }
    ++requests_;
    active.at = Clock::now();
    active.at_start = 0;
    curl().curl_multi_add_handle(multi_, active.request->handle());
}

void FetchLoop::detach(Active& active) {
    if (active.request != nullptr && !active.is_waiting) {
        curl().curl_multi_remove_handle(multi_, active.request->handle());
    }
}

void FetchLoop::read_messages() {
    int left = 0;
    while (const CURLMsg* const message = curl().curl_multi_info_read(multi_, &left)) {
        if (message->msg != CURLMSG_DONE) {
            continue;
        }
        const CURLcode code = message->data.result;
        const auto found =
            std::find_if(active_.begin(), active_.end(), [message](const auto& active) {
                return active->request != nullptr && !active->is_waiting &&
                       active->request->handle() == message->easy_handle;
            });
        if (found != active_.end()) {
            end_request(**found, code);
        }
    }
}

void FetchLoop::end_request(Active& active, CURLcode code) {
    detach(active);
    active.is_waiting = true;  // until it is sent again
    const CurlRequest::Outcome outcome = active.request->finish(code);
    if (outcome.judgement.verdict == Verdict::part && active.request->received() >= kMuch) {
        active.retry.got_on();
    }
    if (outcome.failure) {
        fail_or_retry(active, *outcome.failure);
        return;
    }
    switch (outcome.judgement.verdict) {
        case Verdict::part:
            basis_.waits_for_stream = is_https(active.url) && active.request->has_http2();
            active.object.target = active.url;
            active.redirects = 0;
            if (active.asked.range.size > 0) {
                send(active);  // the server sent less than was requested
            } else {
                finish_with(active, [&active] { active.job->done(); });
            }
            break;
        case Verdict::redirect:
            follow(active, outcome);
            break;
        case Verdict::no_such_range:
            if (outcome.judgement.size == 0) {
                finish_with(active, [&active, &outcome] {
                    active.job->begin(outcome.head, {0, 0}, 0);
                    active.job->done();
                });
                break;
            }
            [[fallthrough]];
        case Verdict::whole:
            ask_for_the_end(active, outcome.judgement.size);
            break;
        case Verdict::changed:
        case Verdict::failed:
            break;  // has a failure
    }
}

void FetchLoop::ask_for_the_end(Active& active, std::uint64_t size) {
    if (active.asked.tail == 0) {
        give_up(active, {FailureClass::final,
                         "the server does not support range requests (Range)",
                         ErrorKind::unsupported,
                         {{RemedyKind::serve_ranges}}});
        return;
    }
    // Some servers support ranges, but not those that count from the end.
    const std::uint64_t bytes = std::min(active.asked.tail, size);
    active.asked = {.range = {size - bytes, bytes}};
    send(active);
}

void FetchLoop::follow(Active& active, const CurlRequest::Outcome& outcome) {
    const std::string to = resolved_location(active.url, outcome.head.location);
    Failure failure{FailureClass::final, "", ErrorKind::io, {{RemedyKind::check_url}}};
    if (to.empty()) {
        failure.problem = "the server redirects to an invalid URL";
    } else if (is_https(active.url) && !is_https(to)) {
        failure.problem = "the server redirects from https to http";
    } else if (++active.redirects > kMaxRedirects) {
        failure.problem = fmt::format("the server redirects more than {} times", kMaxRedirects);
    } else if (basis_.url.keys && !is_own(to)) {
        failure = failure_of_answer(outcome.head, {}, "", true);
        failure.problem += "; it redirects to another server, to which no credentials are sent";
    } else {
        active.url = to;
        send(active);
        return;
    }
    fail_or_retry(active, failure);
}

void FetchLoop::fail_or_retry(Active& active, const Failure& failure) {
    if (failure.is_void && !active.asked.is_whole) {
        give_up(active, failure);  // what the job has received may be wrong
        return;
    }
    if (active.has_begun && active.asked.range.size == 0 && !failure.is_change) {
        finish_with(active, [&active] { active.job->done(); });  // all bytes have come; only the
                                                                 // end of the transfer failed
        return;
    }
    const Clock::time_point now = Clock::now();
    // The target of an earlier redirect may have expired: the original URL gives the current one.
    const bool may_try_origin = !failure.is_change && !active.tried_origin &&
                                active.redirects == 0 && active.url != active.object.request;
    const bool is_final = failure.failure == FailureClass::final;
    const auto wait = may_try_origin && is_final
                          ? std::nullopt
                          : active.retry.wait_after(failure.failure, failure.retry_after, now,
                                                    basis_.options.retry);
    if (!wait && may_try_origin) {
        active.tried_origin = true;
        active.object.target = active.object.request;
        active.retry.got_on();
        send(active);
        return;
    }
    if (!wait) {
        give_up(active, failure);
        return;
    }
    active.redirects = 0;
    active.is_waiting = true;
    active.at = now + *wait;
    if (failure.retry_after) {
        pause_until_ = std::max(pause_until_.value_or(active.at), active.at);
    }
}

void FetchLoop::give_up(Active& active, const Failure& failure) {
    const int tries = active.retry.failures();
    finish_with(active,
                [&] { active.job->failed(error_of(failure, active.object.name, tries), failure); });
}

void FetchLoop::finish_with(Active& active, const std::function<void()>& tell) {
    tell();
    active.job = nullptr;
    if (active.request != nullptr) {
        idle_.push_back(std::move(active.request));
    }
}

void FetchLoop::look_at_the_clock() {
    const Clock::time_point now = Clock::now();
    for (const auto& entry : active_) {
        Active& active = *entry;
        if (active.job == nullptr) {
            continue;
        }
        if (active.is_waiting) {
            if (now >= active.at) {
                send(active);
            }
            continue;
        }
        if (now < active.at + basis_.options.slow_time) {
            continue;
        }
        const std::uint64_t came = active.request->received() - active.at_start;
        active.at = now;
        active.at_start = active.request->received();
        if (came < basis_.options.slow_bytes) {
            detach(active);
            active.is_waiting = true;
            fail_or_retry(
                active,
                {FailureClass::busy,
                 fmt::format("the server is too slow: {} bytes in {:.1f} s", came,
                             static_cast<double>(basis_.options.slow_time.count()) / 1000.0),
                 ErrorKind::io,
                 {{RemedyKind::try_later}}});
        }
    }
}

std::chrono::milliseconds FetchLoop::until_next_event() const {
    const Clock::time_point now = Clock::now();
    Clock::time_point next = now + kLongSleep;
    for (const auto& active : active_) {
        next =
            std::min(next, active->is_waiting ? active->at : active->at + basis_.options.slow_time);
    }
    if (pause_until_) {
        next = std::min(next, *pause_until_);
    }
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(next - now);
    return std::clamp(wait, std::chrono::milliseconds(0), kLongSleep);
}

}  // namespace isonest::detail
