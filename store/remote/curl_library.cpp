#include "store/remote/curl_library.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <string>

#include <isonest/error.h>

#include "store/base/load_failure.h"

namespace isonest::detail {
namespace {

[[noreturn]] void fail_to_load(const char* why) {
    throw Error(ErrorKind::unsupported, fmt::format("URLs need libcurl: {}", why),
                {{RemedyKind::install_package, "libcurl4-openssl-dev"}});
}

template <class Function>
void find_in_curl(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(library, name));
    if (function == nullptr) {
        fail_to_load(fmt::format("libcurl.so.4 is too old, it has no {}", name).c_str());
    }
}

CurlLibrary load_curl() {
    void* const library = ::dlopen("libcurl.so.4", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
        const std::string why = ::dlerror();
        throw_if_no_room_to_load({}, "libcurl, which URLs need", why);
        fail_to_load(why.c_str());
    }
    CurlLibrary functions;
#define ISONEST_CURL_FIND(name) find_in_curl(library, #name, functions.name);
    ISONEST_CURL_FUNCTIONS(ISONEST_CURL_FIND)
#undef ISONEST_CURL_FIND
    if (functions.curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        fail_to_load("it does not start");
    }
    return functions;
}

}  // namespace

const CurlLibrary& curl() {
    static const CurlLibrary functions = load_curl();
    return functions;
}

}  // namespace isonest::detail
