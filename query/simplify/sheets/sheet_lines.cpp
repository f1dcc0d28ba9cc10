#include "query/simplify/sheets/sheet_lines.h"

#include <algorithm>
#include <numeric>

namespace isonest::detail {

SheetLines::SheetLines(std::span<const std::uint32_t> next_copy, std::vector<bool>& locked)
    : next_(next_copy) {
    if (!next_.empty()) {
        first_.resize(next_.size());
        std::iota(first_.begin(), first_.end(), 0U);
    }
    for (std::uint32_t v = 0; v < next_.size(); ++v) {
        bool stays = locked[v];
        std::uint32_t first = v;
        for (std::uint32_t w = next_[v]; w != v; w = next_[w]) {
            stays = stays || locked[w];
            first = std::min(first, w);
        }
        if (first == v && stays) {
            locked[v] = true;
            for (std::uint32_t w = next_[v]; w != v; w = next_[w]) {
                locked[w] = true;
            }
        }
        first_[v] = first;
    }
    known_ = locked;
    silent_ = locked;
    for (std::uint32_t v = 0; v < next_.size(); ++v) {
        known_[v] = known_[v] || next_[v] != v;
        silent_[v] = silent_[v] || first_[v] != v;
    }
}

}  // namespace isonest::detail
