#include "store/remote/open_location.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include <isonest/error.h>

#include "store/bytes/file_bytes.h"
#include "store/remote/object_url.h"

#if ISONEST_WITH_REMOTE
#include "store/bytes/disk_cache.h"
#include "store/remote/url_bytes.h"
#endif

namespace isonest {

bool is_url(std::string_view location) {
    return detail::is_url(location);
}

namespace detail {
namespace {

const char* variable(const char* name) {
    return std::getenv(name);
}

#if ISONEST_WITH_REMOTE
RemoteOptions options_of(const RemoteAccess& remote) {
    RemoteOptions options;
    options.headers = remote.headers;
    options.budget_bytes = std::max(remote.memory, RemoteAccess::kLeastMemory) - kRemoteHeap;
    options.connect_timeout = remote.connect_timeout;
    options.slow_time = remote.slow_time;
    options.retry.total = remote.retry_time;
    options.check = remote.check;
    if (!remote.cache.empty()) {
        options.make_cache = [folder = remote.cache,
                              most = remote.cache_bytes](const ObjectState& object) {
            return make_disk_cache(folder, most, object);
        };
    }
    return options;
}
#endif

}  // namespace

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& location,
                                                [[maybe_unused]] const RemoteAccess& remote) {
    const std::string& text = location.native();
    if (!is_url(text)) {
        return std::make_shared<FileBytes>(location);
    }
#if ISONEST_WITH_REMOTE
    return std::make_shared<UrlBytes>(text, options_of(remote));
#else
    throw Error(ErrorKind::unsupported, {shown_location(text)},
                "this build reads local files alone, as it was made without libcurl",
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
#endif
}

std::string shown_location(std::string_view location) {
    if (!is_url(location)) {
        return std::string(location);
    }
    try {
        return parse_object_url(location, variable).name;
    } catch (const Error& error) {
        return error.place().file;
    }
}

}  // namespace detail
}  // namespace isonest
