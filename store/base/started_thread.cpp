#include "store/base/started_thread.h"

#include <system_error>
#include <utility>

#include <isonest/error.h>

namespace isonest::detail {

std::thread started_thread(const std::string& name, std::function<void()> work) {
    try {
        return std::thread(std::move(work));
    } catch (const std::system_error&) {
        throw Error(ErrorKind::limit, {name}, "the system lets no further thread start",
                    {{RemedyKind::raise_limit, "ulimit -u, ulimit -d, ulimit -v"}});
    }
}

}  // namespace isonest::detail
