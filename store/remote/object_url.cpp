#include "store/remote/object_url.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include <isonest/error.h>

#include "store/base/escaped_text.h"

namespace isonest::detail {
namespace {

constexpr std::string_view kHex = "0123456789ABCDEF";

char lower_of(char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

std::string lower_case(std::string_view text) {
    std::string out(text);
    std::transform(out.begin(), out.end(), out.begin(), lower_of);
    return out;
}

/// The scheme in lower case; empty if there is none.
std::string_view scheme_of(std::string_view text) {
    for (const std::string_view scheme : {"https", "http", "s3"}) {
        const std::size_t size = scheme.size();
        if (text.size() > size + 3 && text.substr(size, 3) == "://" &&
            lower_case(text.substr(0, size)) == scheme) {
            return scheme;
        }
    }
    return {};
}

bool is_unreserved(char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '.' || c == '_' || c == '~';
}

void append_encoded(std::string& out, char c) {
    const auto byte = static_cast<unsigned char>(c);
    out += '%';
    out += kHex[byte >> 4U];
    out += kHex[byte & 15U];
}

/// Encodes a key as required by AWS signatures, and by RFC 3986 for a path.
std::string encoded_key(std::string_view key) {
    std::string out;
    for (const char c : key) {
        if (is_unreserved(c) || c == '/') {
            out += c;
        } else {
            append_encoded(out, c);
        }
    }
    return out;
}

/// Encodes characters that are not allowed in a URL; keeps what is already encoded.
std::string mended(std::string_view part) {
    std::string out;
    for (const char c : part) {
        const auto byte = static_cast<unsigned char>(c);
        if (byte <= 0x20 || byte >= 0x7F || c == '"' || c == '<' || c == '>' || c == '\\' ||
            c == '^' || c == '`' || c == '{' || c == '|' || c == '}') {
            append_encoded(out, c);
        } else {
            out += c;
        }
    }
    return out;
}

struct Authority {
    std::string_view userinfo;
    std::string_view host;  ///< including the port
};

Authority authority_in(std::string_view text) {
    const std::size_t at = text.rfind('@');
    if (at == std::string_view::npos) {
        return {{}, text};
    }
    return {text.substr(0, at), text.substr(at + 1)};
}

bool is_host(std::string_view host) {
    return !host.empty() && host.front() != ':' &&
           std::all_of(host.begin(), host.end(), [](char c) {
               return is_unreserved(c) || c == ':' || c == '[' || c == ']' ||
                      static_cast<unsigned char>(c) >= 0x80;
           });
}

/// Whether the text after the host's colon, if there is one, is a port number. If a password
/// contains an unencoded slash, the authority ends in the middle of the password.
bool has_port_or_none(std::string_view host) {
    const std::size_t bracket = host.rfind(']');
    const std::size_t colon = host.find(':', bracket == std::string_view::npos ? 0 : bracket);
    if (colon == std::string_view::npos) {
        return true;
    }
    const std::string_view port = host.substr(colon + 1);
    return !port.empty() &&
           std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; });
}

[[noreturn]] void refuse(const std::string& name, const std::string& problem) {
    throw Error(ErrorKind::invalid_argument, {name}, problem, {{RemedyKind::check_url}});
}

/// Whether "HOST:PORT" with an @ further on could also be a user and the start of a password with a
/// slash: http://user:12/x@host.
bool may_be_userinfo(std::string_view authority, std::string_view behind) {
    return authority.find_first_of("@[") == std::string_view::npos &&
           authority.find(':') != std::string_view::npos &&
           behind.find('@') != std::string_view::npos;
}

ObjectUrl parse_http(std::string_view scheme, std::string_view rest) {
    const std::size_t path_at = std::min(rest.find_first_of("/?#"), rest.size());
    const auto [userinfo, host] = authority_in(rest.substr(0, path_at));
    const bool is_ambiguous = may_be_userinfo(rest.substr(0, path_at), rest.substr(path_at));
    rest = rest.substr(0, rest.find('#'));
    std::string_view path = rest.substr(path_at);
    const std::size_t query_at = std::min(path.find('?'), path.size());
    const std::string_view query = path.substr(query_at);
    path = path.substr(0, query_at);
    ObjectUrl url;
    url.name = fmt::format("{}://{}{}", scheme, host, path.empty() ? "/" : path);
    if (!is_host(host)) {
        refuse(fmt::format("{}://", scheme), "the URL has no host");
    }
    if (!has_port_or_none(host)) {
        refuse(
            fmt::format("{}://", scheme),
            "the URL's port is not a number; in a password, write / as %2F, ? as %3F and # as %23");
    }
    if (is_ambiguous) {
        refuse(fmt::format("{}://", scheme),
               "the URL has an @ after a colon and a slash; in a path or query, write @ as %40; in "
               "a password, / as %2F, ? as %3F and # as %23");
    }
    url.request =
        fmt::format("{}://{}{}{}", scheme, host, path.empty() ? "/" : mended(path), mended(query));
    const std::size_t colon = std::min(userinfo.find(':'), userinfo.size());
    url.user = percent_decoded(userinfo.substr(0, colon));
    url.password = colon < userinfo.size() ? percent_decoded(userinfo.substr(colon + 1)) : "";
    return url;
}

using Environment = const char* (*)(const char*);

/// The first of these variables that is set and not empty.
template <std::size_t N>
std::string said_by(Environment environment, const std::array<const char*, N>& names) {
    for (const char* const name : names) {
        const char* const value = environment(name);
        if (value != nullptr && *value != 0) {
            return value;
        }
    }
    return {};
}

/// Source: "Bucket naming rules", AWS documentation; older buckets have capitals and underscores.
bool is_bucket(std::string_view bucket) {
    return bucket.size() >= 3 && bucket.size() <= 255 &&
           std::all_of(bucket.begin(), bucket.end(),
                       [](char c) { return is_unreserved(c) && c != '~'; }) &&
           bucket.find("..") == std::string_view::npos;
}

/// Whether a component of the key (between slashes) is "." or "..".
bool has_dot_segment(std::string_view key) {
    for (std::size_t begin = 0; begin <= key.size();) {
        const std::size_t end = std::min(key.find('/', begin), key.size());
        const std::string_view part = key.substr(begin, end - begin);
        if (part == "." || part == "..") {
            return true;
        }
        begin = end + 1;
    }
    return false;
}

ObjectUrl parse_s3(std::string_view rest, Environment environment) {
    const std::size_t slash = std::min(rest.find('/'), rest.size());
    const std::string_view bucket = rest.substr(0, slash);
    const std::string_view key = slash < rest.size() ? rest.substr(slash + 1) : "";
    ObjectUrl url;
    if (!is_bucket(bucket)) {
        refuse("s3://", "the URL has no bucket (s3://BUCKET/KEY)");
    }
    url.name = fmt::format("s3://{}/{}", bucket, key);
    if (key.empty()) {
        refuse(url.name, "the URL has no object key (s3://BUCKET/KEY)");
    }
    url.is_s3 = true;
    const std::string region = said_by<2>(environment, {"AWS_REGION", "AWS_DEFAULT_REGION"});
    SigningKeys keys{said_by<1>(environment, {"AWS_ACCESS_KEY_ID"}),
                     said_by<1>(environment, {"AWS_SECRET_ACCESS_KEY"}),
                     said_by<1>(environment, {"AWS_SESSION_TOKEN"}),
                     region.empty() ? "us-east-1" : region};
    if (keys.id.empty() != keys.secret.empty()) {
        refuse(url.name, "only one of AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY is set");
    }
    if (!keys.id.empty()) {
        url.keys = std::move(keys);
    }
    if (url.keys && has_dot_segment(key)) {
        refuse(url.name, "the key contains . or .. as a path segment, which libcurl does not sign");
    }
    const std::string path = encoded_key(key);
    std::string endpoint = said_by<2>(environment, {"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
    if (!endpoint.empty()) {
        if (scheme_of(endpoint).empty() || scheme_of(endpoint) == "s3") {
            refuse(url.name, "AWS_ENDPOINT_URL is not a URL (https://HOST)");
        }
        // Without userinfo and query, which have no meaning here.
        const ObjectUrl server = parse_http(
            scheme_of(endpoint), std::string_view(endpoint).substr(endpoint.find("://") + 3));
        endpoint = server.name;
        while (endpoint.back() == '/') {
            endpoint.pop_back();
        }
        url.request = fmt::format("{}/{}/{}", endpoint, bucket, path);
        return url;
    }
    const std::string host =
        region.empty() ? "s3.amazonaws.com" : fmt::format("s3.{}.amazonaws.com", region);
    // A certificate for *.host does not cover a bucket with dots.
    url.request = bucket.find('.') == std::string_view::npos
                      ? fmt::format("https://{}.{}/{}", bucket, host, path)
                      : fmt::format("https://{}/{}/{}", host, bucket, path);
    return url;
}

}  // namespace

ObjectUrl parse_object_url(std::string_view text, Environment environment) {
    const std::string_view scheme = scheme_of(text);
    if (scheme.empty()) {
        refuse("", "unsupported URL: give https://, http:// or s3://");
    }
    const std::string_view rest = text.substr(scheme.size() + 3);
    if (std::any_of(text.begin(), text.end(),
                    [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; })) {
        refuse(std::string(scheme) + "://", "the URL has a control character");
    }
    return scheme == "s3" ? parse_s3(rest, environment) : parse_http(scheme, rest);
}

ObjectUrl object_below(const ObjectUrl& folder, std::string_view path) {
    const auto joined = [path](std::string_view start, bool is_encoded) {
        while (start.ends_with('/')) {
            start.remove_suffix(1);
        }
        return fmt::format("{}/{}", start, is_encoded ? encoded_key(path) : std::string(path));
    };
    ObjectUrl object = folder;
    const std::size_t query_at = std::min(folder.request.find('?'), folder.request.size());
    object.name = joined(folder.name, false);
    object.request = joined(std::string_view(folder.request).substr(0, query_at), true) +
                     folder.request.substr(query_at);
    return object;
}

std::string origin_of(std::string_view url) {
    const std::string_view scheme = scheme_of(url);
    const std::string_view rest = url.substr(scheme.size() + 3);
    const std::string host = lower_case(
        authority_in(rest.substr(0, std::min(rest.find_first_of("/?#"), rest.size()))).host);
    const std::size_t colon = host.rfind(':');
    const bool has_port = colon != std::string::npos && host.find(']', colon) == std::string::npos;
    return fmt::format("{}://{}{}", scheme, host,
                       has_port            ? ""
                       : scheme == "https" ? ":443"
                                           : ":80");
}

std::string query_without_signature(std::string_view url) {
    // Parameters of signatures of Amazon, Google and CloudFront, and of Azure's shared access
    // signatures.
    constexpr std::array<std::string_view, 23> kSigning{"signature",
                                                        "expires",
                                                        "awsaccesskeyid",
                                                        "googleaccessid",
                                                        "key-pair-id",
                                                        "policy",
                                                        "sig",
                                                        "se",
                                                        "st",
                                                        "sp",
                                                        "sv",
                                                        "sr",
                                                        "sip",
                                                        "spr",
                                                        "si",
                                                        "skoid",
                                                        "sktid",
                                                        "skt",
                                                        "ske",
                                                        "sks",
                                                        "skv",
                                                        "expiry",
                                                        "expiration"};
    std::string out;
    std::string_view left = url.substr(0, url.find('#'));
    left = left.substr(std::min(left.find('?'), left.size()));
    while (!left.empty()) {
        left = left.substr(1);
        const std::string_view parameter = left.substr(0, left.find('&'));
        left = left.substr(parameter.size());
        const std::string name = lower_case(parameter.substr(0, parameter.find('=')));
        if (!parameter.empty() && !name.starts_with("x-amz-") && !name.starts_with("x-goog-") &&
            std::find(kSigning.begin(), kSigning.end(), name) == kSigning.end()) {
            out += (out.empty() ? "" : "&") + std::string(parameter);
        }
    }
    return out;
}

}  // namespace isonest::detail

bool isonest::is_url(std::string_view location) {
    return !detail::scheme_of(location).empty();
}
