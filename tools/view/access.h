// Who may ask the viewer's server for what.
#pragma once

#include <cstdint>
#include <string>

#include "tools/view/http_messages.h"

namespace isonest::detail::view {

/// What the server accepts.
struct Access {
    std::string address;  ///< that it listens on
    std::uint16_t port = 0;
    std::string token = {};    ///< empty: none is needed
    bool any_address = false;  ///< it listens on all of them: any name of this machine will do,
                               ///< and the token decides
};

/// Why a request is refused, or empty. Pages of other origins may not read, nor start, anything:
/// their requests have another Origin or Sec-Fetch-Site; names that point at this machine without
/// being its own (DNS rebinding) have another Host. `token`: of the request. The page itself, which
/// holds no data, needs neither token nor origin.
std::string why_refused(const Access& access, const HttpRequest& request, const std::string& token,
                        bool is_page);

/// 128 random bits, in hexadecimal digits.
std::string new_token();

}  // namespace isonest::detail::view
