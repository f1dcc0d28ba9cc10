#include "store/remote/retry.h"

#include <algorithm>

namespace isonest::detail {
namespace {

int most_attempts(FailureClass failure, const RetryPolicy& policy) {
    switch (failure) {
        case FailureClass::final:
            return 1;
        case FailureClass::odd:
            return std::min(2, policy.attempts);
        case FailureClass::unreachable:
            return std::min(policy.connect_attempts, policy.attempts);
        case FailureClass::busy:
            return policy.attempts;
    }
    return 1;
}

}  // namespace

std::optional<std::chrono::milliseconds> RetryState::wait_after(
    FailureClass failure, std::optional<std::chrono::seconds> retry_after, Clock::time_point now,
    const RetryPolicy& policy) {
    constexpr int kMostDoublings = 20;
    if (!first_failure_) {
        first_failure_ = now;
    }
    ++failures_;
    if (failures_ >= most_attempts(failure, policy)) {
        return std::nullopt;
    }
    const std::int64_t grown = policy.first_wait.count() << std::min(failures_ - 1, kMostDoublings);
    const double longest = static_cast<double>(std::min(grown, policy.longest_wait.count()));
    const double part = std::uniform_real_distribution<double>(0.5, 1)(random_);
    std::chrono::milliseconds wait(static_cast<std::int64_t>(longest * part));
    if (retry_after) {
        wait = std::max<std::chrono::milliseconds>(wait, *retry_after);
    }
    if (now + wait > *first_failure_ + policy.total) {
        return std::nullopt;
    }
    return wait;
}

}  // namespace isonest::detail
