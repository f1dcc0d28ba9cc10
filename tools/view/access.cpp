#include "tools/view/access.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>

#include <isonest/error.h>

namespace isonest::detail::view {
namespace {

/// Takes as long for a wrong token as for the right one.
bool same(const std::string& a, const std::string& b) {
    if (a.size() != b.size()) {
        return false;
    }
    unsigned difference = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        difference |= static_cast<unsigned>(static_cast<unsigned char>(a[i]) ^
                                            static_cast<unsigned char>(b[i]));
    }
    return difference == 0;
}

bool is_own_host(const Access& access, const std::string& host) {
    const std::string port = fmt::format(":{}", access.port);
    const std::string address =
        access.address.find(':') == std::string::npos ? access.address : "[" + access.address + "]";
    if (host == address + port || host == "localhost" + port) {
        return true;
    }
    constexpr std::uint16_t kDefaultPort = 80;  // which browsers leave out
    if (access.port == kDefaultPort && (host == address || host == "localhost")) {
        return true;
    }
    return access.any_address && !host.empty();
}

}  // namespace

std::string why_refused(const Access& access, const HttpRequest& request, const std::string& token,
                        bool is_page) {
    if (!is_own_host(access, request.host)) {
        return "the Host of the request is not this server";
    }
    if (is_page) {
        return {};
    }
    if (!request.origin.empty() && request.origin != "http://" + request.host) {
        return "pages of other origins get nothing from this server";
    }
    if (!request.fetch_site.empty() && request.fetch_site != "same-origin" &&
        request.fetch_site != "none") {
        return "pages of other sites get nothing from this server";
    }
    if (!access.token.empty() && !same(access.token, token)) {
        return "the token is missing or wrong: it is in the URL that the server printed";
    }
    return {};
}

std::string new_token() {
    std::array<unsigned char, 16> bytes{};
    if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
        throw Error(ErrorKind::io, "the system gives no random numbers");
    }
    std::string token;
    for (const unsigned char byte : bytes) {
        token += fmt::format("{:02x}", byte);
    }
    return token;
}

}  // namespace isonest::detail::view
