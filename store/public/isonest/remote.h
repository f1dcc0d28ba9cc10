// Stores that are elsewhere: how they are reached, and what was fetched of them.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest {

/// Whether this names an object elsewhere: https://, http:// or s3://, in any case of letters. A
/// local file of such a name is reached by "./" in front.
bool is_url(std::string_view location);

/// How a store elsewhere is reached. Credentials may also stand in the URL, in ~/.netrc, and for
/// s3:// in the environment (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN); proxies
/// and certificates are those of the environment, as curl has them.
struct RemoteAccess {
    /// "Name: value" each, sent to the URL's own server alone. They may hold secrets.
    std::vector<std::string> headers = {};
    /// A folder that keeps what was fetched beyond this process; empty: none does.
    std::filesystem::path cache = {};
    /// Bytes that the folder holds at most, of all stores together.
    std::uint64_t cache_bytes = std::uint64_t{1} << 30U;
    /// Bytes of heap for what was fetched, at most, beside the memory of queries; at least
    /// kLeastMemory is taken.
    std::uint64_t memory = std::uint64_t{64} << 20U;
    static constexpr std::uint64_t kLeastMemory = std::uint64_t{16} << 20U;
    std::chrono::milliseconds connect_timeout{10'000};
    /// A request in which next to nothing comes for so long has failed.
    std::chrono::milliseconds slow_time{20'000};
    /// From the first failure on, what may be tried again is tried for so long.
    std::chrono::milliseconds retry_time{60'000};
    /// Called about every 50 ms by each thread that waits for the network, from any thread; what it
    /// throws ends the wait, and is thrown by the query. Empty: nothing.
    std::function<void()> check = {};
};

/// What was fetched of a store until now; all 0 for a local file.
struct FetchedCounts {
    std::uint64_t remote_bytes = 0;  ///< of bodies that came over the network
    std::uint64_t requests = 0;      ///< sent, repeated ones counted again
    std::uint64_t round_trips = 0;   ///< times that somebody had to wait for the network
    std::uint64_t cache_bytes = 0;   ///< that came from the cache on disk instead
};

}  // namespace isonest
