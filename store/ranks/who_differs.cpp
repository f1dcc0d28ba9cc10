#include "store/ranks/who_differs.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstddef>
#include <vector>

namespace isonest::detail {

std::string who_differs(Communicator& ranks, std::string_view own, std::string_view expected) {
    const std::vector<std::string> all = ranks.gather(fmt::format("{}\n{}", own, ranks.host()));
    std::vector<std::string> names;
    constexpr std::size_t kMost = 8;
    for (std::size_t r = 0; r < all.size(); ++r) {
        const std::size_t end = all[r].find('\n');
        if (all[r].substr(0, end) != expected) {
            names.push_back(fmt::format("{} ({})", r, all[r].substr(end + 1)));
        }
    }
    const std::size_t more = names.size() > kMost ? names.size() - kMost : 0;
    names.resize(names.size() - more);
    return fmt::format("{}{}", fmt::join(names, ", "),
                       more > 0 ? fmt::format(" and {} more", more) : "");
}

}  // namespace isonest::detail
