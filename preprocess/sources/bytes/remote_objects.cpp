#include "preprocess/sources/bytes/remote_objects.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include <isonest/error.h>

#include "store/base/escaped_text.h"
#include "store/bytes/disk_cache.h"
#include "store/remote/open_location.h"

namespace isonest::detail {
namespace {

/// Whether a name can only refer to something in or below the folder.
bool stays_below(std::string_view name) {
    if (name.empty() || name.front() == '/' || name.find("://") != std::string_view::npos ||
        std::any_of(name.begin(), name.end(), [](char c) {
            return static_cast<unsigned char>(c) < 0x20 || c == 0x7F || c == '\\';
        })) {
        return false;
    }
    while (true) {
        const std::size_t slash = std::min(name.find('/'), name.size());
        const std::string_view part = name.substr(0, slash);
        if (part.empty() || part == "." || part == "..") {
            return false;
        }
        if (slash == name.size()) {
            return true;
        }
        name = name.substr(slash + 1);
    }
}

/// An S3 key is plain text; nothing in it is percent-encoded.
bool is_s3(std::string_view url) {
    return url.starts_with('s') || url.starts_with('S');
}

/// Percent-encodes a path: characters with a meaning in URLs, and those that are not allowed there.
std::string as_path(std::string_view name) {
    constexpr std::string_view kPlain = "-._~/!$&'()*+,;=:@";
    std::string out;
    for (const char c : name) {
        const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                           (c >= '0' && c <= '9') || kPlain.find(c) != std::string_view::npos;
        out += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
    return out;
}

}  // namespace

RemoteObjects::RemoteObjects(RemoteAccess remote)
    : remote_(std::move(remote)),
      cache_(remote_.cache.empty()
                 ? nullptr
                 : std::make_shared<const DiskCache>(remote_.cache, remote_.cache_bytes)) {}

std::shared_ptr<const StoreBytes> RemoteObjects::open(const std::string& url) {
    std::shared_ptr<const StoreBytes> bytes = open_location(url, remote_, cache_);
    const std::lock_guard lock(mutex_);
    opened_.push_back(bytes);
    return bytes;
}

FetchedCounts RemoteObjects::fetched() const {
    const std::lock_guard lock(mutex_);
    FetchedCounts all;
    for (const std::shared_ptr<const StoreBytes>& bytes : opened_) {
        const FetchedCounts one = bytes->fetched();
        all.remote_bytes += one.remote_bytes;
        all.requests += one.requests;
        all.round_trips += one.round_trips;
        all.cache_bytes += one.cache_bytes;
    }
    return all;
}

std::string RemoteObjects::cache_warning() const {
    return cache_ ? cache_->warning() : std::string();
}

std::uint64_t RemoteObjects::window() const {
    return (std::max(remote_.memory, RemoteAccess::kMinMemory) - kRemoteHeap) * 3 / 8;
}

std::string last_part_of(std::string_view url) {
    const std::string_view part = url.substr(url.rfind('/') + 1);
    if (is_s3(url)) {
        return std::string(part);
    }
    return percent_decoded(part);
}

std::string url_beside(std::string_view url, std::string_view name, const std::string& shown) {
    if (!stays_below(name)) {
        throw Error(ErrorKind::unsupported, {shown},
                    fmt::format("the data are in '{:.200}'; at a URL, they must be in the header's "
                                "folder or a subfolder",
                                name),
                    {{RemedyKind::download}});
    }
    const std::size_t host = url.find("://") + 3;
    const bool has_key = is_s3(url);
    std::string_view query;
    if (!has_key) {
        // An S3 key has no query: all characters belong to the key.
        url = url.substr(0, url.find('#'));
        const std::size_t mark = std::min(url.find('?'), url.size());
        query = url.substr(mark);
        url = url.substr(0, mark);
    }
    const std::size_t slash = url.rfind('/');
    const std::string_view folder = slash < host ? url : url.substr(0, slash);
    return fmt::format("{}/{}{}", folder, has_key ? std::string(name) : as_path(name), query);
}

}  // namespace isonest::detail
