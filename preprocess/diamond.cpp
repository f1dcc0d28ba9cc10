#include "preprocess/diamond.h"

#include <algorithm>
#include <bit>
#include <mutex>

#include "store/bisection.h"
#include "store/lattice.h"

namespace isonest {
namespace {

bool is_flat(unsigned flat, int axis) {
    return ((flat >> static_cast<unsigned>(axis)) & 1U) != 0;
}

bool in_flat_space(const Int3& offset, unsigned flat) {
    for (int axis = 0; axis < 3; ++axis) {
        if (is_flat(flat, axis) && offset[axis] != 0) {
            return false;
        }
    }
    return true;
}

/// The part of a tetrahedron in the space of the axes that are not flat; fewer vertices than an
/// element has if it only touches that space.
DiamondElement trace(const Tetrahedron& t, const Int3& node, unsigned flat) {
    DiamondElement element;
    element.vertices = 0;
    const auto add = [&](const Int3& v) {
        if (in_flat_space(v - node, flat)) {
            element.v[static_cast<std::size_t>(element.vertices++)] = v - node;
        }
    };
    add(t.ref_end0());
    add(t.ref_end1());
    for (const Int3& v : t.v) {
        if (v != t.ref_end0() && v != t.ref_end1()) {
            add(v);
        }
    }
    return element;
}

bool same_vertices(const DiamondElement& a, const DiamondElement& b) {
    return std::all_of(a.v.begin(), a.v.begin() + a.vertices, [&](const Int3& v) {
        return std::find(b.v.begin(), b.v.begin() + b.vertices, v) != b.v.begin() + b.vertices;
    });
}

std::vector<DiamondElement> make_diamond(int slot, const Int3& parity, unsigned flat) {
    std::vector<DiamondElement> found;
    // A cube away from the origin, so that all coordinates are positive.
    const Int3 owner = parity + Int3{4, 4, 4};
    const Int3 node = owner * 2 + slot_offset(slot);
    const int vertices = 4 - std::popcount(flat);
    for (std::int64_t i = 0; i < 27; ++i) {
        const Int3 around = (Int3{3, 3, 3}).unlinear(i) - Int3{1, 1, 1};
        if (!in_flat_space(around, flat)) {
            continue;
        }
        for (int order = 0; order < 6; ++order) {
            std::vector<Tetrahedron> level{kuhn_tetrahedron(owner + around, 2, order)};
            for (int step = 0; step < 3; ++step) {
                std::vector<Tetrahedron> next;
                for (const Tetrahedron& t : level) {
                    DiamondElement element = trace(t, node, flat);
                    element.cube = around;
                    const bool known = std::any_of(
                        found.begin(), found.end(),
                        [&](const DiamondElement& e) { return same_vertices(e, element); });
                    if (t.ref_node() == node && element.vertices == vertices && !known) {
                        found.push_back(element);
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

}  // namespace

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

}  // namespace isonest
