// Remote stores: how to access them, and what was fetched.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest {

/// Whether `location` is the URL of a remote object: https://, http:// or s3://, in upper or lower
/// case. Prefix "./" to open a local file of such a name.
bool is_url(std::string_view location);

/// How to access a remote store. Credentials may also be given in the URL, in ~/.netrc, and for
/// s3:// in the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN). Proxies
/// and certificates are taken from the environment, as curl does.
struct RemoteAccess {
    /// "Name: value" each, sent only to the server of the URL. They may contain secrets.
    std::vector<std::string> headers = {};
    /// A folder that caches fetched data across processes; empty: no cache.
    std::filesystem::path cache = {};
    /// Maximum bytes in the cache folder, over all stores.
    std::uint64_t cache_bytes = std::uint64_t{1} << 30U;
    /// Maximum bytes of heap for fetched data, in addition to the memory of queries; smaller values
    /// are raised to kMinMemory.
    std::uint64_t memory = std::uint64_t{64} << 20U;
    static constexpr std::uint64_t kMinMemory = std::uint64_t{16} << 20U;
    [[deprecated("now called kMinMemory")]] static constexpr std::uint64_t kLeastMemory =
        kMinMemory;
    std::chrono::milliseconds connect_timeout{10'000};
    /// A request fails if almost no data arrives for this long.
    std::chrono::milliseconds slow_time{20'000};
    /// How long a failed request may be retried, counted from the first failure.
    std::chrono::milliseconds retry_time{60'000};
    /// Called about every 50 ms by each thread that waits for the network, from any thread. An
    /// exception that it throws ends the wait and is thrown by the query. Empty: not called.
    std::function<void()> check = {};
};

/// What was fetched from a store so far; all 0 for a local file.
struct FetchedCounts {
    std::uint64_t remote_bytes = 0;  ///< bytes of response bodies that came over the network
    std::uint64_t requests = 0;      ///< requests sent, including retries
    std::uint64_t round_trips = 0;   ///< how often somebody had to wait for the network
    std::uint64_t cache_bytes = 0;   ///< bytes read from the cache on disk instead
};

}  // namespace isonest
