// The remote objects that one volume is read from.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/remote.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

class DiskCache;

/// Opens objects with the same settings, and counts what is fetched from all of them.
/// Thread-safety: all methods from any thread.
class RemoteObjects {
  public:
    /// Throws what DiskCache throws.
    explicit RemoteObjects(RemoteAccess remote);

    /// Throws what open_location() throws.
    std::shared_ptr<const StoreBytes> open(const std::string& url);
    [[nodiscard]] const RemoteAccess& remote() const { return remote_; }
    [[nodiscard]] FetchedCounts fetched() const;
    /// See VolumeSource::cache_warning().
    [[nodiscard]] std::string cache_warning() const;
    /// How many bytes of an object are prefetched ahead of the reader: less than half of what is
    /// cached of it, so that prefetching never evicts bytes that were not read yet.
    [[nodiscard]] std::uint64_t window() const;

  private:
    RemoteAccess remote_;
    std::shared_ptr<const DiskCache> cache_;
    mutable std::mutex mutex_;
    std::vector<std::shared_ptr<const StoreBytes>> opened_;
};

/// The last part of the path of a URL without a query, decoded to text as url_beside() takes it.
std::string last_part_of(std::string_view url);

/// The URL of an object beside another one, or below its folder. `name` is text (not
/// percent-encoded). Keeps the other URL's query, in which some servers expect credentials. Refuses
/// a name that leads elsewhere (absolute, a URL, ".."): Error{unsupported}, about `shown`.
std::string url_beside(std::string_view url, std::string_view name, const std::string& shown);

}  // namespace isonest::detail
