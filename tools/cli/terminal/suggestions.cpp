#include "tools/cli/terminal/suggestions.h"

#include <algorithm>
#include <cstddef>

namespace isonest::detail::cli {
namespace {

std::size_t edits(const std::string& a, const std::string& b) {
    std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
    for (std::size_t i = 0; i <= a.size(); ++i) {
        for (std::size_t j = 0; j <= b.size(); ++j) {
            if (i == 0 || j == 0) {
                d[i][j] = i + j;
                continue;
            }
            const std::size_t same = a[i - 1] == b[j - 1] ? 0 : 1;
            d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + same});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
                d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
            }
        }
    }
    return d[a.size()][b.size()];
}

}  // namespace

std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names) {
    constexpr std::size_t kLongest = 64;
    std::optional<std::string> nearest;
    std::size_t least = word.size() / 3 + 1;
    for (const std::string& name : names) {
        if (word.size() > kLongest) {
            break;
        }
        // The beginning of a longer name may be meant, too.
        const std::size_t count = name.starts_with(word) && word.size() > 3 ? 1 : edits(word, name);
        if (count < least) {
            least = count;
            nearest = name;
        }
    }
    return nearest;
}

}  // namespace isonest::detail::cli
