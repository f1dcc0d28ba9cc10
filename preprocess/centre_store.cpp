#include "preprocess/centre_store.h"

#include <algorithm>

namespace isonest {

void CentreStore::allocate(int level, Field what) {
    const auto cells = static_cast<std::uint64_t>(lattice_.elements_at(level).product());
    const auto it = files_.emplace(std::pair{level, what}, ScratchFile(folder_)).first;
    it->second.map(cells * sizeof(float));
}

void CentreStore::release(int level) {
    std::erase_if(files_, [&](const auto& entry) { return entry.first.first == level; });
}

void CentreStore::put(int level, Field what, const Box<float>& centres) {
    const Int3 cells = lattice_.elements_at(level);
    const auto to = files_.at({level, what}).as<float>();
    for (std::int64_t z = centres.lo.z; z < centres.lo.z + centres.size.z; ++z) {
        for (std::int64_t y = centres.lo.y; y < centres.lo.y + centres.size.y; ++y) {
            std::copy_n(centres.row(y, z), centres.size.x,
                        to.data() + cells.linear({centres.lo.x, y, z}));
        }
    }
}

void CentreStore::get(int level, Field what, float outside, Box<float>& centres) const {
    const Int3 cells = lattice_.elements_at(level);
    const auto from = files_.at({level, what}).as<float>();
    std::fill(centres.data.begin(), centres.data.end(), outside);
    const Int3 first = max(centres.lo, {0, 0, 0});
    const Int3 end = min(centres.lo + centres.size, cells);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y && first.x < end.x; ++y) {
            std::copy_n(from.data() + cells.linear({first.x, y, z}), end.x - first.x,
                        centres.row(y, z) + (first.x - centres.lo.x));
        }
    }
}

}  // namespace isonest
