#include "store/remote/open_url.h"

#include <cstdlib>
#include <utility>

#include <isonest/error.h>

#include "store/remote/object_url.h"
#if ISONEST_WITH_REMOTE
#include "store/remote/url_bytes.h"
#endif

namespace isonest::detail {

std::unique_ptr<StoreBytes> open_url(std::string_view url,
                                     [[maybe_unused]] const RemoteOptions& options) {
    ObjectUrl parsed =
        parse_object_url(url, [](const char* name) -> const char* { return std::getenv(name); });
#if ISONEST_WITH_REMOTE
    return std::make_unique<UrlBytes>(std::move(parsed), options);
#else
    throw Error(ErrorKind::unsupported, {parsed.name},
                "this isonest was built without libcurl, which reads URLs",
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
#endif
}

}  // namespace isonest::detail
