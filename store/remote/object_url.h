// URLs of remote objects, and credentials.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/remote.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// Keys for AWS signatures. Source: "Signature Version 4", AWS documentation.
struct SigningKeys {
    std::string id;
    std::string secret;
    std::string session;  ///< token; may be empty
    std::string region;
};

/// What to request from which server, with which credentials. Only `name` may appear in messages.
struct ObjectUrl {
    std::string name;      ///< as given, without userinfo, query and fragment
    std::string request;   ///< http(s)://host[:port]/path[?query], percent-encoded
    std::string user;      ///< of the userinfo, decoded
    std::string password;  ///< of the userinfo, decoded
    bool is_s3 = false;    ///< from an s3:// URL, even if requests are not signed
    std::optional<SigningKeys> keys;
};

/// `environment`: std::getenv, or a replacement for tests. Used for s3 URLs only:
/// AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION or AWS_DEFAULT_REGION,
/// AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL; without keys, requests are not signed. The key of an s3
/// URL is everything after the bucket; no character in it has a special meaning. Throws
/// Error{invalid_argument}.
ObjectUrl parse_object_url(std::string_view text, const char* (*environment)(const char*));

/// The object `path` below a URL that stands for a folder, with the query, keys and passwords of
/// the URL. `path`: not encoded, separated by '/'. No I/O.
ObjectUrl object_below(const ObjectUrl& folder, std::string_view path);

/// scheme://host:port in lower case, with the scheme's default port if there is none: equal for two
/// URLs of the same server. REQUIRES: is_url(url) (<isonest/remote.h>, defined here).
std::string origin_of(std::string_view url);

/// The parameters of a URL's query, without those that only grant access or limit its duration.
std::string query_without_signature(std::string_view url);

// Options for reading remote objects.

/// When and how often failed requests are repeated. Waits grow by a factor of 2, with jitter.
struct RetryPolicy {
    int attempts = 6;          ///< maximum number of requests for one range, including the first
    int connect_attempts = 3;  ///< if nobody answers at all
    std::chrono::milliseconds first_wait{250};
    std::chrono::milliseconds longest_wait{8000};
    /// Maximum time from the first failure on; a longer Retry-After is not waited for.
    std::chrono::milliseconds total{60'000};
};

struct RemoteOptions {
    /// "Name: value" each, only for the server of the URL; they may contain secrets.
    std::vector<std::string> headers = {};
    /// Maximum bytes of fetched data in memory, unless callers hold more.
    std::uint64_t budget_bytes = std::uint64_t{64} << 20U;
    int parallel_requests = 16;
    int parallel_streams = 64;  ///< the same with HTTP/2, where requests share a connection
    RetryPolicy retry = {};
    std::chrono::milliseconds connect_timeout{10'000};
    /// A request fails if fewer than this many bytes come within slow_time.
    std::uint64_t slow_bytes = 20'000;
    std::chrono::milliseconds slow_time{20'000};
    /// Called every 50 ms by each thread that waits for the network, in that thread; an exception
    /// that it throws ends the wait, like Progress::check().
    std::function<void()> check = {};
    /// Creates the cache that keeps ranges beyond this opening, for the object in the state that
    /// was found. If it is null or returns null, there is no cache.
    std::function<std::shared_ptr<RangeCache>(const ObjectState&)> make_cache = {};
    /// `recall` returns the state in which an object was last found, given its `url` and `query`;
    /// `remember` stores it. If it is known, opening requests only the last few bytes, and takes
    /// the others from the cache if the object is still in that state.
    std::function<std::optional<ObjectState>(const ObjectState&)> recall = {};
    std::function<void(const ObjectState&)> remember = {};
};

}  // namespace isonest::detail
