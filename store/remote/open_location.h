// Where a store is, as a user names it: a path or a URL. Every store is opened by this.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include <isonest/remote.h>

#include "store/bytes/object_folder.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

class DiskCache;

/// The bytes of a local file, or of an object elsewhere; `cache`: that of remote.cache, or null.
/// Throws what FileBytes and open_url() throw.
std::shared_ptr<const StoreBytes> open_location(
    const std::filesystem::path& location, const RemoteAccess& remote = {},
    const std::shared_ptr<const DiskCache>& cache = nullptr);

/// What lies below a URL. Throws what open_url_folder() throws.
std::shared_ptr<ObjectFolder> open_folder_location(const std::filesystem::path& location,
                                                   const RemoteAccess& remote);

/// That of remote.cache; null if none is asked for, or `location` is no URL.
std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& location,
                                            const RemoteAccess& remote);
/// What is wrong with it, empty if nothing is or it is null.
std::string cache_warning(const DiskCache* cache);

/// For messages: a path as it is, a URL without userinfo, query and fragment.
std::string shown_location(std::string_view location);

/// Whether this can be one of RemoteAccess::headers: "Name: value" in one line, of a name that is
/// not one of those by which ranges and states of objects are asked for.
bool is_header(std::string_view line);

/// Heap of RemoteAccess::memory that is not for bytes of chunks: pages of the chunk table, and
/// libcurl's connections.
inline constexpr std::uint64_t kRemoteHeap = std::uint64_t{12} << 20U;

}  // namespace isonest::detail
