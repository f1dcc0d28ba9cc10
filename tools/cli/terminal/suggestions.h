// What somebody may have meant who mistyped a name.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace isonest::detail::cli {

/// The one of `names` that differs least from `word`: by no more than a third of its letters being
/// inserted, left out, replaced, or swapped with the next one. Source: F. Damerau, "A technique for
/// computer detection and correction of spelling errors", CACM 7 (1964).
std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names);

/// Up to `most` of them that differ as little, the nearest first.
std::vector<std::string> nearest_names(const std::string& word,
                                       const std::vector<std::string>& names, std::size_t most);

}  // namespace isonest::detail::cli
