// The objects elsewhere that one volume is read from.
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

/// Opens objects in one way, and counts what is fetched of all of them. Thread-safety: all methods
/// from any thread.
class FarObjects {
  public:
    /// Throws what DiskCache throws.
    explicit FarObjects(RemoteAccess remote);

    /// Throws what open_location() throws.
    std::shared_ptr<const StoreBytes> open(const std::string& url);
    [[nodiscard]] const RemoteAccess& remote() const { return remote_; }
    [[nodiscard]] FetchedCounts fetched() const;
    /// See VolumeSource::cache_warning().
    [[nodiscard]] std::string cache_warning() const;
    /// How many bytes of an object are announced ahead of who reads them: less than half of what is
    /// kept of it, so that nothing that was not read is dropped for what is announced.
    [[nodiscard]] std::uint64_t window() const;

  private:
    RemoteAccess remote_;
    std::shared_ptr<const DiskCache> cache_;
    mutable std::mutex mutex_;
    std::vector<std::shared_ptr<const StoreBytes>> opened_;
};

/// The last part of a URL without query, as text: not encoded, as url_beside() takes it.
std::string last_part_of(std::string_view url);

/// The URL of an object beside another one, or below its folder, by its name as text (not
/// encoded); with the other one's query, in which some servers expect credentials. A name that
/// leads elsewhere (absolute, a URL, "..") is refused: Error{unsupported}, about `shown`.
std::string url_beside(std::string_view url, std::string_view name, const std::string& shown);

}  // namespace isonest::detail
