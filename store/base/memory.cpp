#include "store/base/memory.h"

#include <fmt/format.h>

#include <utility>

namespace isonest::detail {

void require_memory(const std::string& subject, std::uint64_t memory, std::uint64_t least,
                    const std::string& for_what, std::vector<Remedy> also) {
    if (memory >= least) {
        return;
    }
    const std::string given =
        memory >> 20U > 0 ? fmt::format("{} MiB", memory >> 20U) : fmt::format("{} bytes", memory);
    const std::uint64_t enough = ((least >> 20U) + 1) << 20U;
    also.insert(also.begin(), {RemedyKind::more_memory, std::to_string(enough)});
    throw Error(ErrorKind::limit, {subject},
                fmt::format("a memory of {} is not enough for {}", given, for_what),
                std::move(also));
}

}  // namespace isonest::detail
