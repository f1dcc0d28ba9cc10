#include "store/remote/open_location.h"

#include <algorithm>
#include <cstdlib>

#include <isonest/error.h>

#include "store/bytes/disk_cache.h"
#include "store/bytes/file_bytes.h"
#include "store/remote/object_url.h"
#include "store/remote/open_url.h"

namespace isonest {

bool is_url(std::string_view location) {
    return detail::is_url(location);
}

namespace detail {
namespace {

RemoteOptions options_of(const RemoteAccess& remote,
                         const std::shared_ptr<const DiskCache>& cache) {
    RemoteOptions options;
    options.headers = remote.headers;
    options.budget_bytes = std::max(remote.memory, RemoteAccess::kLeastMemory) - kRemoteHeap;
    options.connect_timeout = remote.connect_timeout;
    options.slow_time = remote.slow_time;
    options.retry.total = remote.retry_time;
    options.check = remote.check;
    if (cache) {
        options.make_cache = [cache](const ObjectState& object) -> std::shared_ptr<RangeCache> {
            return cache->of(object);
        };
    }
    return options;
}

}  // namespace

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& location,
                                                const RemoteAccess& remote,
                                                const std::shared_ptr<const DiskCache>& cache) {
    if (!is_url(location.native())) {
        return std::make_shared<FileBytes>(location);
    }
    return open_url(location.native(), options_of(remote, cache));
}

std::string shown_location(std::string_view location) {
    if (!is_url(location)) {
        return std::string(location);
    }
    try {
        return parse_object_url(location,
                                [](const char* name) -> const char* { return std::getenv(name); })
            .name;
    } catch (const Error& error) {
        return error.place().file;
    }
}

}  // namespace detail
}  // namespace isonest
