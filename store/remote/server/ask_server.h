// One question to a server as a browser puts it, and all that it answers: for what looks at
// servers.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace isonest::detail {

struct ServerQuestion {
    std::string url;  ///< http(s)
    std::string method = "GET";
    std::vector<std::string> headers = {};  ///< "Name: value"
    /// Bytes of the body that are kept; the rest is not waited for.
    std::size_t most_body = std::size_t{1} << 20U;
};

struct ServerReply {
    int status = 0;
    std::vector<std::pair<std::string, std::string>> headers;  ///< names in lower case
    std::string body;
    bool is_whole = true;  ///< the body is not longer than what was kept
    int redirects = 0;     ///< followed until then; five at most

    /// All values of a header, with ", " between them; empty if there is none.
    [[nodiscard]] std::string header(std::string_view name) const;
    [[nodiscard]] bool has(std::string_view name) const;
};

/// Any status is an answer. `check` is called about once a second while it waits; what it throws
/// ends the wait. Throws Error{io} if nobody answers, Error{unsupported} where the library was
/// built without libcurl, Error{invalid_argument} if it is no URL. Thread-safety: none is shared.
ServerReply ask_server(const ServerQuestion& question, const std::function<void()>& check);

}  // namespace isonest::detail
