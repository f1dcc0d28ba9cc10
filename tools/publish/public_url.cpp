// Names of parameters that carry secrets: RFC 6750, section 2.3 (access_token); the others are
// those of common services (GitLab private_token, job_token; Google key; Azure code, sas).
#include "tools/publish/public_url.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>

#include <isonest/error.h>

#include "store/base/percent_text.h"
#include "store/remote/object_url.h"

namespace isonest::detail::publish {
namespace {

/// Letters and digits alone, lower case, of a name that may be percent-encoded.
std::string plain_name(std::string_view name) {
    std::string plain;
    for (const char c : percent_decoded(name)) {
        if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) {
            plain += c;
        } else if (c >= 'A' && c <= 'Z') {
            plain += static_cast<char>(c + ('a' - 'A'));
        }
    }
    return plain;
}

bool is_secret(std::string_view parameter) {
    constexpr std::array kNames{
        "auth",      "authorization",   "authkey",    "bearer",    "jwt",
        "sid",       "session",         "sas",        "apikey",    "accesskey",
        "code",      "sharekey",        "passwd",     "pwd",       "passphrase",
        "sessionid", "subscriptionkey", "privatekey", "secretkey", "pass"};
    constexpr std::array kEnds{"token", "secret", "password", "credential", "credentials"};
    const std::size_t equals = std::min(parameter.find('='), parameter.size());
    const std::string name = plain_name(parameter.substr(0, equals));
    const std::string_view value = parameter.substr(std::min(equals + 1, parameter.size()));
    if (value.empty()) {
        return false;
    }
    if (name == "key") {  // of an object, too, which is a path
        return value.find('/') == std::string_view::npos &&
               value.find("%2F") == std::string_view::npos &&
               value.find("%2f") == std::string_view::npos && !value.ends_with(".isonest");
    }
    return std::find(kNames.begin(), kNames.end(), name) != kNames.end() ||
           std::any_of(kEnds.begin(), kEnds.end(),
                       [&](const char* end) { return name.ends_with(end); });
}

}  // namespace

std::string public_url(const std::string& text) {
    if (!is_url(text)) {
        throw Error(ErrorKind::invalid_argument, {text},
                    "is no URL of a store (https://HOST/PATH)");
    }
    const ObjectUrl url = parse_object_url(text, [](const char* /*name*/) -> const char* {
        return nullptr;  // whoever looks at the site has not this machine's keys
    });
    const std::size_t query = std::min(url.request.find('?'), url.request.size() - 1) + 1;
    const bool is_signed = query_without_signature(url.request) != url.request.substr(query);
    if (!url.user.empty() || !url.password.empty() || is_signed) {
        throw Error(ErrorKind::invalid_argument, {url.name},
                    "the URL holds a password or a signature, and everybody could read it on the "
                    "site: give one that works without");
    }
    std::string_view rest = std::string_view(url.request).substr(query);
    while (!rest.empty()) {
        const std::string_view parameter = rest.substr(0, rest.find('&'));
        rest = rest.substr(std::min(parameter.size() + 1, rest.size()));
        if (is_secret(parameter)) {
            throw Error(
                ErrorKind::invalid_argument, {url.name},
                fmt::format("the URL's parameter '{}' looks like a secret, and everybody could "
                            "read it on the site: let the server give the store without it, and "
                            "give that URL",
                            plain_name(parameter.substr(0, parameter.find('=')))));
        }
    }
    return url.request;
}

}  // namespace isonest::detail::publish
