// Whether a web server answers as a page without a server needs it, and what to change if not.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <isonest/progress.h>

namespace isonest::detail::publish {

/// What a server can do wrong.
enum class ServerFault {
    none,
    missing,      ///< there is no such file, or it is none of isonest's
    length,       ///< HEAD does not say how long the store is
    ranges,       ///< a part of the store is not what comes
    encoding,     ///< the store comes compressed
    etag,         ///< nothing tells one state of the store from another
    origin,       ///< CORS: pages of other servers may not read it
    exposed,      ///< CORS: they do not see the ETag
    preflight,    ///< CORS: they may not ask for a part, where browsers ask first
    wasm_type,    ///< the library has another media type
    script_type,  ///< a script has one that browsers do not run
    compression   ///< the library comes as it is: three times as many bytes
};

struct ServerFinding {
    std::string url;
    std::string what;                       ///< was looked at: "ranges"
    ServerFault fault = ServerFault::none;  ///< none: it is right
    bool is_needed = true;                  ///< else it is better so
    std::string found;                      ///< in words
};

struct ServerCheck {
    bool is_site = false;  ///< else a store
    std::vector<ServerFinding> findings;

    /// Nothing is wrong that is needed.
    [[nodiscard]] bool is_right() const;
    [[nodiscard]] bool has(ServerFault fault) const;
};

/// `url`: of a published folder (or its index.html), or of a store, which is then looked at as one
/// that a page of `origin` ("https://example.org") reads. Throws Error{io} if nobody answers,
/// Error{invalid_argument, unsupported} as ask_server() does.
ServerCheck check_server(const std::string& url, const std::string& origin, Progress& progress);

/// Lines to add, for one kind of server.
struct ServerLines {
    std::string server;  ///< "nginx"
    std::string where;   ///< they belong
    std::string lines;
};
/// For what was found wrong, or could be better; empty if nothing was.
std::vector<ServerLines> lines_to_add(const ServerCheck& check);

std::string_view name_of(ServerFault fault);

}  // namespace isonest::detail::publish
