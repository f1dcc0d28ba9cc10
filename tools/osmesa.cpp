#include "tools/osmesa.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include "store/error.h"

namespace isonest {
namespace {

template <class Function>
void find(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(library, name));
    if (function == nullptr) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("libOSMesa.so.8 has no {}: install Debian's libosmesa6", name));
    }
}

OsMesa load() {
    void* const library = ::dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("pictures need libOSMesa: {}; install libosmesa6", ::dlerror()));
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

}  // namespace isonest
