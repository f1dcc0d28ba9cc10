// Names of objects elsewhere, and who asks for them.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include <isonest/remote.h>

namespace isonest::detail {

/// Keys of Amazon's signatures. Source: "Signature Version 4", AWS documentation.
struct SigningKeys {
    std::string id;
    std::string secret;
    std::string session;  ///< token; may be empty
    std::string region;
};

/// What is asked of whom, and as whom. Nothing of it is for messages but `name`.
struct ObjectUrl {
    std::string name;      ///< as it was given, without userinfo, query and fragment
    std::string request;   ///< http(s)://host[:port]/path[?query], percent-encoded
    std::string user;      ///< of the userinfo, decoded
    std::string password;  ///< of the userinfo, decoded
    bool is_s3 = false;    ///< of an s3:// URL, also if nobody signs
    std::optional<SigningKeys> keys;
};

/// `environment`: std::getenv, or a test's. What it says: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY,
/// AWS_SESSION_TOKEN, AWS_REGION or AWS_DEFAULT_REGION, AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL,
/// for s3 URLs alone; without keys, nobody signs. The key of an s3 URL is what follows the bucket,
/// with no character that means anything else. Throws Error{invalid_argument}.
ObjectUrl parse_object_url(std::string_view text, const char* (*environment)(const char*));

/// The object `path` below a URL that stands for a folder; the URL's query goes along, and so do
/// its keys and passwords. `path`: not encoded, with '/' between its parts. No I/O.
ObjectUrl object_below(const ObjectUrl& folder, std::string_view path);

/// scheme://host:port, in lower case and with the scheme's port if there is none: of two URLs for
/// the same server it is the same. REQUIRES: is_url(url) (<isonest/remote.h>, defined here).
std::string origin_of(std::string_view url);

/// The parameters of a URL's query, without those that only say who may read and how long.
std::string query_without_signature(std::string_view url);

}  // namespace isonest::detail
