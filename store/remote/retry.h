// When a request that failed is sent again.
//
// Source of waits that grow with jitter: M. Brooker, "Exponential Backoff And Jitter", AWS
// Architecture Blog (2015); here half of each wait is fixed.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <random>

#include "store/remote/answer.h"
#include "store/remote/remote_options.h"

namespace isonest::detail {

/// What became of one range until now.
class RetryState {
  public:
    using Clock = std::chrono::steady_clock;

    explicit RetryState(std::uint32_t seed) : random_(seed) {}

    /// How long to wait until it is asked for again; nothing: that was the last failure.
    /// `retry_after`: what the server said.
    std::optional<std::chrono::milliseconds> wait_after(
        FailureClass failure, std::optional<std::chrono::seconds> retry_after,
        Clock::time_point now, const RetryPolicy& policy);
    /// The last request brought much: the failures before it do not count, but their time does.
    void got_on() { failures_ = 0; }
    /// Requests that failed since there was progress.
    [[nodiscard]] int failures() const { return failures_; }

  private:
    std::minstd_rand random_;
    int failures_ = 0;
    std::optional<Clock::time_point> first_failure_;
};

}  // namespace isonest::detail
