#include "store/remote/open_location.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include <isonest/error.h>

#include "store/bytes/disk_cache.h"
#include "store/bytes/file_bytes.h"
#include "store/remote/object_url.h"
#include "store/remote/open_url.h"

namespace isonest::detail {
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
        options.recall = [cache](const ObjectState& object) { return cache->last_of(object); };
        options.remember = [cache](const ObjectState& object) { cache->remember(object); };
    }
    return options;
}

void check_headers(const std::filesystem::path& location, const RemoteAccess& remote) {
    if (!std::all_of(remote.headers.begin(), remote.headers.end(), is_header)) {
        throw Error(ErrorKind::invalid_argument, {shown_location(location.native())},
                    "a header has to be one line, 'Name: value', and none about ranges");
    }
}

}  // namespace

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& location,
                                                const RemoteAccess& remote,
                                                const std::shared_ptr<const DiskCache>& cache) {
    if (!is_url(location.native())) {
        return std::make_shared<FileBytes>(location);
    }
    check_headers(location, remote);
    return open_url(location.native(), options_of(remote, cache));
}

std::shared_ptr<ObjectFolder> open_folder_location(const std::filesystem::path& location,
                                                   const RemoteAccess& remote) {
    check_headers(location, remote);
    return open_url_folder(location.native(), options_of(remote, nullptr));
}

std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& location,
                                            const RemoteAccess& remote) {
    return !remote.cache.empty() && is_url(location.native())
               ? std::make_shared<const DiskCache>(remote.cache, remote.cache_bytes)
               : nullptr;
}

std::string cache_warning(const DiskCache* cache) {
    return cache != nullptr ? cache->warning() : std::string();
}

bool is_header(std::string_view line) {
    constexpr std::string_view kOthers = "!#$%&'*+-.^_`|~";
    constexpr std::array<std::string_view, 8> kOurs{
        "range",           "if-range",          "if-match",
        "if-none-match",   "if-modified-since", "if-unmodified-since",
        "accept-encoding", "content-length"};
    const std::size_t colon = line.find(':');
    std::string name(line.substr(0, colon));
    std::transform(name.begin(), name.end(), name.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    return colon != std::string_view::npos && !name.empty() &&
           std::all_of(name.begin(), name.end(),
                       [&](char c) {
                           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
                                  kOthers.find(c) != std::string_view::npos;
                       }) &&
           std::find(kOurs.begin(), kOurs.end(), name) == kOurs.end() &&
           std::all_of(line.begin(), line.end(), [](char c) {
               return (static_cast<unsigned char>(c) >= ' ' && c != 0x7F) || c == '\t';
           });
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

}  // namespace isonest::detail
