#include "tools/cli/terminal/suggestions.h"

#include <algorithm>
#include <cstddef>
#include <utility>

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

std::vector<std::string> nearest_names(const std::string& word,
                                       const std::vector<std::string>& names, std::size_t most) {
    constexpr std::size_t kLongest = 64;
    if (word.size() > kLongest) {
        return {};
    }
    const std::size_t least = word.size() / 3 + 1;
    std::vector<std::pair<std::size_t, std::string>> near;
    for (const std::string& name : names) {
        // The beginning of a longer name may be meant, too.
        const bool begins = name.starts_with(word) && word.size() > 3;
        if (!begins && name.size() >= word.size() + least) {
            continue;  // at least so many letters are missing
        }
        const std::size_t count = begins ? 1 : edits(word, name);
        if (count < least) {
            near.emplace_back(count, name);
        }
    }
    std::stable_sort(near.begin(), near.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    near.resize(std::min(near.size(), most));
    std::vector<std::string> nearest;
    for (auto& [count, name] : near) {
        nearest.push_back(std::move(name));
    }
    return nearest;
}

std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names) {
    const std::vector<std::string> nearest = nearest_names(word, names, 1);
    return nearest.empty() ? std::nullopt : std::optional(nearest.front());
}

}  // namespace isonest::detail::cli
