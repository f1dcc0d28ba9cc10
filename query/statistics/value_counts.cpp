#include "query/statistics/value_counts.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace isonest::detail {

void ValueCounts::add_nodes(const Box<BinCode>& box, const Int3& own) {
    for (std::int64_t z = 0; z < own.z; ++z) {
        for (std::int64_t y = 0; y < own.y; ++y) {
            const BinCode* const row = box.row(box.lo.y + y, box.lo.z + z);
            for (std::int64_t x = 0; x < own.x; ++x) {
                ++nodes_[row[x]];
            }
        }
    }
}

void ValueCounts::add_cubes(const Box<BinCode>& box, const Int3& cells) {
    // A code less 1, modulo 2^16, is the bin, and of a missing value more than any.
    constexpr auto kNone = std::numeric_limits<BinCode>::max();
    const auto bin = [](BinCode code) { return static_cast<BinCode>(code - 1U); };
    const Int3 step = min(box.size - Int3{1, 1, 1}, {1, 1, 1});
    const auto row_nodes = static_cast<std::size_t>(box.size.x);
    std::vector<BinCode> low(row_nodes);
    std::vector<BinCode> high(row_nodes);
    for (std::int64_t z = 0; z < cells.z; ++z) {
        for (std::int64_t y = 0; y < cells.y; ++y) {
            const BinCode* const a = box.row(box.lo.y + y, box.lo.z + z);
            const BinCode* const b = box.row(box.lo.y + y + step.y, box.lo.z + z);
            const BinCode* const c = box.row(box.lo.y + y, box.lo.z + z + step.z);
            const BinCode* const d = box.row(box.lo.y + y + step.y, box.lo.z + z + step.z);
            for (std::size_t x = 0; x < row_nodes; ++x) {
                const BinCode low_ab = std::min(bin(a[x]), bin(b[x]));
                const BinCode low_cd = std::min(bin(c[x]), bin(d[x]));
                low[x] = std::min(low_ab, low_cd);
                const BinCode high_ab = std::max(a[x], b[x]);
                const BinCode high_cd = std::max(c[x], d[x]);
                high[x] = std::max(high_ab, high_cd);
            }
            for (std::int64_t x = 0; x < cells.x; ++x) {
                const auto i = static_cast<std::size_t>(x);
                const auto j = static_cast<std::size_t>(x + step.x);
                const BinCode least = std::min(low[i], low[j]);
                const BinCode most = std::max(high[i], high[j]);
                if (least != kNone) {
                    add_cube(least, most - 1);
                }
            }
        }
    }
}

void ValueCounts::add(const ValueCounts& other) {
    const auto plus = std::plus<>();
    std::transform(nodes_.begin(), nodes_.end(), other.nodes_.begin(), nodes_.begin(), plus);
    std::transform(changes_.begin(), changes_.end(), other.changes_.begin(), changes_.begin(),
                   plus);
}

std::vector<std::uint64_t> ValueCounts::cubes() const {
    std::vector<std::uint64_t> cubes(changes_.size() - 1);
    std::partial_sum(changes_.begin(), changes_.end() - 1, cubes.begin());
    return cubes;
}

}  // namespace isonest::detail
