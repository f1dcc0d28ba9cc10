#include "store/remote/open_url.h"

#include <cstdlib>
#include <utility>

#include <isonest/error.h>

#include "store/remote/object_url.h"
#if ISONEST_WITH_REMOTE
#include "store/remote/url_bytes.h"
#include "store/remote/url_folder.h"
#endif

namespace isonest::detail {

namespace {

ObjectUrl parsed_url(std::string_view url) {
    return parse_object_url(url, [](const char* name) -> const char* { return std::getenv(name); });
}

#if !ISONEST_WITH_REMOTE
[[noreturn]] void refuse_urls(const ObjectUrl& url) {
    throw Error(ErrorKind::unsupported, {url.name},
                "this isonest was built without libcurl, which reads URLs",
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
}
#endif

}  // namespace

std::unique_ptr<StoreBytes> open_url(std::string_view url,
                                     [[maybe_unused]] const RemoteOptions& options) {
    ObjectUrl parsed = parsed_url(url);
#if ISONEST_WITH_REMOTE
    return std::make_unique<UrlBytes>(std::move(parsed), options);
#else
    refuse_urls(parsed);
#endif
}

std::unique_ptr<ObjectFolder> open_url_folder(std::string_view url,
                                              [[maybe_unused]] const RemoteOptions& options) {
    const ObjectUrl parsed = parsed_url(url);
#if ISONEST_WITH_REMOTE
    return std::make_unique<UrlFolder>(parsed, options);
#else
    refuse_urls(parsed);
#endif
}

}  // namespace isonest::detail
