#include "tools/cli/commands/same_store.h"

#include <fmt/format.h>

#include <isonest/error.h>

#include "store/ranks/who_differs.h"

namespace isonest::detail::cli {

void require_same_store(Communicator& ranks, const StoreReader* store, const std::string& name) {
    const std::string own = store != nullptr ? fmt::format("{:016x}", store->identity()) : "none";
    const std::string others = who_differs(ranks, own, own);
    if (ranks.rank() == 0 && !others.empty()) {
        throw Error(
            ErrorKind::invalid_argument, {name},
            fmt::format("is {}, but not the same to ranks {}; all ranks have to see one file",
                        store != nullptr ? "a store" : "no store", others));
    }
    ranks.meet();
}

}  // namespace isonest::detail::cli
