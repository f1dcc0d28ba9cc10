#include "store/base/load_failure.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include <isonest/error.h>

namespace isonest::detail {

void throw_if_no_room_to_load(const std::string& file, const std::string& whole,
                              std::string_view why) {
    const auto says = [why](std::string_view words) {
        return why.find(words) != std::string_view::npos;
    };
    // In the C library's words (glibc, elf/dl-load.c, dl-map-segments.h and others).
    constexpr std::array<std::string_view, 7> kNoMemory{"cannot map zero-fill pages",
                                                        "failed to map segment",
                                                        "annot allocate memory",
                                                        "cannot allocate",
                                                        "out of memory",
                                                        "cannot create shared object",
                                                        "cannot create search path"};
    if (std::any_of(kNoMemory.begin(), kNoMemory.end(), says)) {
        throw Error(ErrorKind::limit, {file},
                    fmt::format("there is no memory to load {} ({})", whole, why),
                    {{RemedyKind::raise_limit, "ulimit -d, ulimit -v"}});
    }
    if (says("Too many open files")) {
        throw Error(ErrorKind::limit, {file}, fmt::format("cannot load {} ({})", whole, why),
                    {{RemedyKind::raise_limit, "ulimit -n"}});
    }
}

}  // namespace isonest::detail
