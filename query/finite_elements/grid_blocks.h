// The blocks of an implicit grid, and its leaves that are larger than a block.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7. Blocks are grouped by the parities of their
// coordinates: blocks of one group share no node, so their sums may be added in parallel, and each
// node gets its sums group by group in a fixed order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "query/finite_elements/block_elements.h"
#include "query/finite_elements/grid_elements.h"

namespace isonest::detail {

struct GridBlock {
    std::array<std::uint32_t, 3> corner;
    std::uint32_t elements;  ///< bits of the walks, in the order of coarsest_elements()
};

struct GridBlocks {
    int level = 0;
    std::array<std::vector<GridBlock>, 8> groups;  ///< by the parities of their coordinates
};

/// REQUIRES, also below: the set was made by active_nodes(), lattice.dimension() == D.
template <int D>
GridBlocks find_blocks(const Lattice& lattice, const NodeSet& nodes) {
    GridBlocks blocks;
    blocks.level = std::min(kBlockLevel<D>, lattice.top());
    ActiveNumbers numbers(nodes);
    const WithinVolume volume{lattice.nodes() - Int3{1, 1, 1}};
    GridTraverse<D> traverse(numbers, volume, Everything{}, StopsAtInactive{});
    const auto orders = axis_orders<D>(lattice);
    std::vector<Element<D>> left;
    auto nothing = [](const Element<D>&, double, Overlap) {};
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        traverse.above(t, blocks.level, nothing, left);
    }
    std::vector<std::pair<Int3, std::uint32_t>> found;
    for (const Element<D>& t : left) {
        if (volume.overlap(t) != Overlap::outside) {
            const auto walk = std::find(orders.begin(), orders.end(), axes_of(t)) - orders.begin();
            found.emplace_back(t.bounds().first, 1U << static_cast<unsigned>(walk));
        }
    }
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
        const auto key = [](const auto& f) {
            return std::array{f.first.z, f.first.y, f.first.x, std::int64_t{f.second}};
        };
        return key(a) < key(b);
    });
    for (const auto& [corner, element] : found) {
        const Int3 block{corner.x >> blocks.level, corner.y >> blocks.level,
                         corner.z >> blocks.level};
        auto& same = blocks.groups.at(
            static_cast<std::size_t>((block.x & 1) + 2 * (block.y & 1) + 4 * (block.z & 1)));
        const std::array<std::uint32_t, 3> at{static_cast<std::uint32_t>(corner.x),
                                              static_cast<std::uint32_t>(corner.y),
                                              static_cast<std::uint32_t>(corner.z)};
        if (same.empty() || same.back().corner != at) {
            same.push_back({at, 0});
        }
        same.back().elements |= element;
    }
    return blocks;
}

/// What the blocks of a grid have in common; without functions and terms.
template <class Real, int D>
BlockCommon<Real, D> block_common(const Lattice& lattice, const NodeSet& nodes, int block_level) {
    BlockCommon<Real, D> common;
    common.nodes = &nodes;
    common.level = block_level;
    common.cells = std::int64_t{1} << block_level;
    common.flat = lattice.flat_axes();
    common.walks = axis_orders<D>(lattice);
    return common;
}

/// Calls act.template operator()<Kind>(leaf) for each leaf that is larger than a block, in a fixed
/// order.
template <int D, class Action>
void for_coarse_leaves(const Lattice& lattice, const NodeSet& nodes, int block_level,
                       const Action& act) {
    auto action = [&](const Element<D>& leaf, double, Overlap) {
        if constexpr (D == 3) {
            leaf.kind == 0   ? act.template operator()<0>(leaf)
            : leaf.kind == 1 ? act.template operator()<1>(leaf)
                             : act.template operator()<2>(leaf);
        } else if constexpr (D == 2) {
            leaf.kind == 0 ? act.template operator()<0>(leaf) : act.template operator()<1>(leaf);
        } else {
            act.template operator()<0>(leaf);
        }
    };
    ActiveNumbers numbers(nodes);
    GridTraverse<D> traverse(numbers, WithinVolume{lattice.nodes() - Int3{1, 1, 1}}, Everything{},
                             StopsAtInactive{});
    std::vector<Element<D>> left;
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        traverse.above(t, block_level, action, left);
    }
}

}  // namespace isonest::detail
