// Checks whether a web server answers in the way that published pages need, and suggests changes to
// its configuration.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <isonest/progress.h>

namespace isonest::detail::publish {

/// Possible faults of a server.
enum class ServerFault {
    none,
    missing,      ///< the file does not exist, or is not isonest's
    length,       ///< HEAD does not give the length of the store
    ranges,       ///< range requests return something else
    encoding,     ///< the store is sent compressed
    etag,         ///< nothing distinguishes one version of the store from another
    origin,       ///< CORS: pages of other servers may not read it
    exposed,      ///< CORS: such pages cannot see the ETag
    preflight,    ///< CORS: such pages may not request ranges where browsers ask first
    wasm_type,    ///< the library has the wrong media type
    script_type,  ///< a script has a media type that browsers refuse to run
    compression   ///< the library is sent uncompressed: three times as many bytes
};

struct ServerFinding {
    std::string url;
    std::string what;                       ///< what was checked: "ranges"
    ServerFault fault = ServerFault::none;  ///< none: no fault
    bool is_needed = true;                  ///< false: only recommended
    std::string found;                      ///< in words
};

struct ServerCheck {
    bool is_site = false;  ///< otherwise a store
    std::vector<ServerFinding> findings;

    /// Whether nothing that is needed is wrong.
    [[nodiscard]] bool is_right() const;
    [[nodiscard]] bool has(ServerFault fault) const;
};

/// Checks the server of a published folder (`url` may end with its index.html) or of a store. For a
/// store, checks whether a page of `origin` ("https://example.org") can read it. Throws Error{io}
/// if the server does not answer, and Error{invalid_argument, unsupported} like ask_server().
ServerCheck check_server(const std::string& url, const std::string& origin, Progress& progress);

/// Configuration lines to add, for one kind of server.
struct ServerLines {
    std::string server;  ///< "nginx"
    std::string where;   ///< where they belong
    std::string lines;
};
/// Lines for the faults found and for what could be better; empty if there are none.
std::vector<ServerLines> lines_to_add(const ServerCheck& check);

std::string_view name_of(ServerFault fault);

}  // namespace isonest::detail::publish
