// In a page, a location is a URL that the page's worker reads.
#include "tools/web/open_web.h"

#include <string>
#include <utility>

#include "store/remote/open_location.h"

namespace isonest::detail {
namespace web {
namespace {

std::shared_ptr<WebBytes>& current() {
    static std::shared_ptr<WebBytes> bytes;
    return bytes;
}

}  // namespace

void set_web_bytes(std::shared_ptr<WebBytes> bytes) {
    current() = std::move(bytes);
}

}  // namespace web

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& /*location*/,
                                                const RemoteAccess& /*remote*/,
                                                const std::shared_ptr<const DiskCache>& /*cache*/) {
    return web::current();
}

std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& /*location*/,
                                            const RemoteAccess& /*remote*/) {
    return nullptr;
}

std::string cache_warning(const DiskCache* /*cache*/) {
    return {};
}

}  // namespace isonest::detail
