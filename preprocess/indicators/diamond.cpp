#include "preprocess/indicators/diamond.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <mutex>

#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

bool same_vertices(const DiamondElement& a, const DiamondElement& b) {
    return std::all_of(a.v.begin(), a.v.begin() + a.vertices, [&](const Int3& v) {
        return std::find(b.v.begin(), b.v.begin() + b.vertices, v) != b.v.begin() + b.vertices;
    });
}

std::vector<DiamondElement> make_diamond(int slot, const Int3& parity, unsigned flat) {
    // A cube away from the origin, so that all coordinates are positive.
    const Int3 owner = parity + Int3{4, 4, 4};
    const Int3 node = owner * 2 + slot_offset(slot);
    std::vector<DiamondElement> found;
    for (const Tetrahedron& t : tetrahedra_around(owner, 2, node, flat)) {
        DiamondElement element;
        element.v = {t.ref_end0() - node, t.ref_end1() - node};
        element.vertices = 2;
        for (const Int3& v : trace(t, node, flat)) {
            if (v != t.ref_end0() && v != t.ref_end1()) {
                element.v[static_cast<std::size_t>(element.vertices++)] = v - node;
            }
        }
        Int3 low = t.v[0];
        for (const Int3& v : t.v) {
            low = min(low, v);
        }
        element.cube = Int3{low.x / 2, low.y / 2, low.z / 2} - owner;
        const bool known = std::any_of(found.begin(), found.end(), [&](const DiamondElement& e) {
            return same_vertices(e, element);
        });
        if (!known) {
            found.push_back(element);
        }
    }
    return found;
}

}  // namespace

bool in_flat_space(const Int3& offset, unsigned flat) {
    for (int axis = 0; axis < 3; ++axis) {
        if (((flat >> static_cast<unsigned>(axis)) & 1U) != 0 && offset[axis] != 0) {
            return false;
        }
    }
    return true;
}

std::vector<Int3> trace(const Tetrahedron& t, const Int3& node, unsigned flat) {
    std::vector<Int3> vertices;
    std::copy_if(t.v.begin(), t.v.end(), std::back_inserter(vertices),
                 [&](const Int3& v) { return in_flat_space(v - node, flat); });
    return vertices;
}

std::vector<Tetrahedron> tetrahedra_around(const Int3& cube, std::int64_t edge, const Int3& node,
                                           unsigned flat) {
    const auto vertices = static_cast<std::size_t>(4 - std::popcount(flat));
    std::vector<Tetrahedron> found;
    for (std::int64_t i = 0; i < 27; ++i) {
        const Int3 around = (Int3{3, 3, 3}).unlinear(i) - Int3{1, 1, 1};
        for (int order = 0; order < 6 && in_flat_space(around, flat); ++order) {
            std::vector<Tetrahedron> level{kuhn_tetrahedron(cube + around, edge, order)};
            for (int step = 0; step < 3; ++step) {
                std::vector<Tetrahedron> next;
                for (const Tetrahedron& t : level) {
                    if (t.ref_node() == node && trace(t, node, flat).size() == vertices) {
                        found.push_back(t);
                    }
                    for (const Tetrahedron& child : t.bisect()) {
                        next.push_back(child);
                    }
                }
                level = std::move(next);
            }
        }
    }
    return found;
}

const std::vector<DiamondElement>& diamond(int slot, unsigned parities, unsigned flat) {
    constexpr std::size_t kTables = std::size_t{8} * 8 * kSlots;
    static std::array<std::vector<DiamondElement>, kTables> tables;
    static std::array<std::once_flag, kTables> made;
    const std::size_t i = (flat * 8 + parities) * kSlots + static_cast<std::size_t>(slot);
    std::call_once(made.at(i), [&] {
        tables[i] =
            make_diamond(slot, {parities & 1U, (parities >> 1U) & 1U, parities >> 2U}, flat);
    });
    return tables[i];
}

}  // namespace isonest::detail
