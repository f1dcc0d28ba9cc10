#include "tools/drawing/osmesa.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cstdlib>
#include <string>

#include <isonest/error.h>

#include "store/base/load_failure.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

template <class Function>
void find(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(library, name));
    if (function == nullptr) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("libOSMesa.so.8 has no {}: install Debian's libosmesa6", name));
    }
}

/// Mesa waits for ever for drawing threads that the system did not let it start.
void draw_without_threads_where_they_are_refused() {
    constexpr int kBesideThem = 4;
    try {
        require_threads(Workers::count_of(0) + kBesideThem);
    } catch (const Error&) {
        ::setenv("LP_NUM_THREADS", "0", 1);
    }
}

OsMesa load() {
    draw_without_threads_where_they_are_refused();
    void* const library = ::dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
        const std::string why = ::dlerror();
        throw_if_no_room_to_load({}, "libOSMesa, which draws pictures", why);
        throw Error(ErrorKind::unsupported,
                    fmt::format("pictures need libOSMesa: {}; install libosmesa6", why));
    }
    OsMesa functions;
#define ISONEST_OSMESA_FIND(name) find(library, #name, functions.name);
    ISONEST_OSMESA_FUNCTIONS(ISONEST_OSMESA_FIND)
#undef ISONEST_OSMESA_FIND
    return functions;
}

}  // namespace

const OsMesa& osmesa() {
    static const OsMesa functions = load();
    return functions;
}

}  // namespace isonest::detail
