// How objects elsewhere are read.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "store/bytes/range_cache.h"

namespace isonest::detail {

/// What is tried again, how often and after how long. Waits grow by a factor of 2, with jitter.
struct RetryPolicy {
    int attempts = 6;          ///< of one range at most, the first one counted
    int connect_attempts = 3;  ///< where nobody answers at all
    std::chrono::milliseconds first_wait{250};
    std::chrono::milliseconds longest_wait{8000};
    /// From the first failure on; a longer Retry-After is not waited for.
    std::chrono::milliseconds total{60'000};
};

struct RemoteOptions {
    /// "Name: value" each, for the URL's own server alone; they may hold secrets.
    std::vector<std::string> headers = {};
    /// Of what was fetched and is kept in memory, as long as nobody holds more.
    std::uint64_t budget_bytes = std::uint64_t{64} << 20U;
    int parallel_requests = 16;
    int parallel_streams = 64;  ///< the same by HTTP/2, where requests share a connection
    RetryPolicy retry = {};
    std::chrono::milliseconds connect_timeout{10'000};
    /// A request fails if fewer than this many bytes come within slow_time.
    std::uint64_t slow_bytes = 20'000;
    std::chrono::milliseconds slow_time{20'000};
    /// Called every 50 ms by whoever waits for the network, in its own thread; what it throws ends
    /// the wait, as Progress::check() does.
    std::function<void()> check = {};
    /// Where ranges are kept beyond this opening, for the object in the state that was found; null,
    /// or a call that gives null: nowhere.
    std::function<std::shared_ptr<RangeCache>(const ObjectState&)> make_cache = {};
    /// The state in which an object was found last, of which `url` and `query` are given, and what
    /// is told of that. Where it is known, opening asks for the last few bytes alone, and takes the
    /// others from the cache if the object still is in that state.
    std::function<std::optional<ObjectState>(const ObjectState&)> recall = {};
    std::function<void(const ObjectState&)> remember = {};
};

}  // namespace isonest::detail
