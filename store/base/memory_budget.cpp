#include "store/base/memory_budget.h"

#include <fmt/format.h>

#include <isonest/error.h>

namespace isonest::detail {

void require_memory(const std::string& subject, std::uint64_t memory, std::uint64_t least,
                    const std::string& for_what, const std::string& way_out) {
    if (memory >= least) {
        return;
    }
    const std::string given =
        memory >> 20U > 0 ? fmt::format("{} MiB", memory >> 20U) : fmt::format("{} bytes", memory);
    throw Error(ErrorKind::limit,
                fmt::format("{}: a memory of {} is too little for {}: give at least --memory {}M{}",
                            subject, given, for_what, (least >> 20U) + 1, way_out));
}

}  // namespace isonest::detail
