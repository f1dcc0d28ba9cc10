// The location of a store, as users give it: a path or a URL. Every store is opened here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/remote.h>

#include "store/bytes/store_bytes.h"
#include "store/remote/object_url.h"

namespace isonest::detail {

// Remote objects as the bytes of a store.

/// Opens an object with one request (two if the server does not support ranges that count from the
/// end); its last 64 KiB are then available. `url`: is_url(). Throws Error{invalid_argument,
/// not_found, io, unsupported}, and what options.check throws.
std::unique_ptr<StoreBytes> open_url(std::string_view url, const RemoteOptions& options);

/// The objects below a URL; sends no request yet. Throws Error{invalid_argument, unsupported}.
std::unique_ptr<ObjectFolder> open_url_folder(std::string_view url, const RemoteOptions& options);

// One request to a server, as a browser sends it, with the complete answer: for diagnosing servers.

struct ServerQuestion {
    std::string url;  ///< http(s)
    std::string method = "GET";
    std::vector<std::string> headers = {};  ///< "Name: value"
    /// Maximum bytes of the body to keep; the rest is not waited for.
    std::size_t max_body = std::size_t{1} << 20U;
};

struct ServerReply {
    int status = 0;
    std::vector<std::pair<std::string, std::string>> headers;  ///< names in lower case
    std::string body;
    bool is_whole = true;  ///< the whole body was kept
    int redirects = 0;     ///< number of redirects followed; at most five

    /// All values of a header, separated by ", "; empty if there is none.
    [[nodiscard]] std::string header(std::string_view name) const;
    [[nodiscard]] bool has(std::string_view name) const;
};

/// Any status is an answer. `check` is called about once a second while waiting; an exception that
/// it throws ends the wait. Throws Error{io} if nobody answers, Error{unsupported} if the library
/// was built without libcurl, Error{invalid_argument} for an invalid URL. Thread-safety: no shared
/// state.
ServerReply ask_server(const ServerQuestion& question, const std::function<void()>& check);

class DiskCache;

/// The bytes of a local file, or of a remote object. `cache`: that of remote.cache, or null. Throws
/// what FileBytes and open_url() throw.
std::shared_ptr<const StoreBytes> open_location(
    const std::filesystem::path& location, const RemoteAccess& remote = {},
    const std::shared_ptr<const DiskCache>& cache = nullptr);

/// The objects below a URL. Throws what open_url_folder() throws.
std::shared_ptr<ObjectFolder> open_folder_location(const std::filesystem::path& location,
                                                   const RemoteAccess& remote);

/// The cache in remote.cache; null if none is requested, or `location` is not a URL.
std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& location,
                                            const RemoteAccess& remote);
/// What is wrong with the cache; empty if nothing is, or if it is null.
std::string cache_warning(const DiskCache* cache);

/// For messages: a path unchanged, a URL without userinfo, query and fragment.
std::string shown_location(std::string_view location);

/// Whether this can be one of RemoteAccess::headers: "Name: value" in one line, and not one of the
/// headers that request ranges and states of objects.
bool is_header(std::string_view line);

/// The part of the heap in RemoteAccess::memory that is not for bytes of chunks: pages of the chunk
/// table, and libcurl's connections.
inline constexpr std::uint64_t kRemoteHeap = std::uint64_t{12} << 20U;

}  // namespace isonest::detail
