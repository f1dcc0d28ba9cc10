#include "preprocess/indicators/offset_norms.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <mutex>

#include "store/lattice/lattice.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

bool same_vertices(const DiamondElement& a, const DiamondElement& b) {
    return std::all_of(a.v.begin(), a.v.begin() + a.vertices, [&](const Int3& v) {
        return std::find(b.v.begin(), b.v.begin() + b.vertices, v) != b.v.begin() + b.vertices;
    });
}

std::vector<DiamondElement> make_diamond(int slot, const Int3& parity, unsigned flat) {
    // A cube far enough from the origin that all coordinates are positive.
    const Int3 owner = parity + Int3{4, 4, 4};
    const Int3 node = owner * 2 + slot_offset(slot);
    std::vector<DiamondElement> found;
    for (const Tetrahedron& t : tetrahedra_around(owner, 2, node, flat)) {
        DiamondElement element;
        element.v = {t.v[0] - node, t.v[t.ref_end()] - node};
        element.vertices = 2;
        for (const Int3& v : trace(t, node, flat)) {
            if (v != t.v[0] && v != t.v[t.ref_end()]) {
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

OffsetNorms::OffsetNorms(const LatticeSteps& steps, int level, unsigned flat)
    : flat_(flat), dimension_(3 - std::popcount(flat)) {
    const double half_edge = std::ldexp(1.0, level - 1);
    for (int s = 0; s < kSlots; ++s) {
        if ((static_cast<unsigned>(s + 1) & flat) != 0) {
            continue;
        }
        for (const DiamondElement& element : diamond(s, 0, flat)) {
            if (element.cube == Int3{0, 0, 0}) {
                add(element, steps, half_edge, slots_[static_cast<std::size_t>(s)]);
            }
        }
    }
    if (!steps.is_sheared()) {
        return;
    }
    constexpr int kParities = 8;
    sheared_.resize(std::size_t{kParities} * kSlots * kSides * kSides * kSides);
    for (std::size_t i = 0; i < sheared_.size(); ++i) {
        constexpr int kAll = kSides * kSides * kSides;
        const auto sides = Int3{kSides, kSides, kSides}.unlinear(static_cast<int>(i) % kAll);
        const int slot = static_cast<int>(i) / kAll % kSlots;
        const auto parities = static_cast<unsigned>(static_cast<int>(i) / kAll / kSlots);
        if (((parities | static_cast<unsigned>(slot + 1)) & flat) != 0) {
            continue;
        }
        for (const DiamondElement& element : diamond(slot, parities, flat)) {
            bool there = true;
            for (int axis = 0; axis < 3; ++axis) {
                const bool before = element.cube[axis] < 0;
                there = there && sides[axis] != (before ? 0 : 1);
            }
            if (there) {
                add(element, steps, half_edge, sheared_[i]);
            }
        }
    }
}

/// Adds the contributions of the two children of an element.
void OffsetNorms::add(const DiamondElement& element, const LatticeSteps& steps, double half_edge,
                      Slot& slot) const {
    const auto world = [&](const Int3& p) {
        return steps.vector({static_cast<double>(p.x) * half_edge,
                             static_cast<double>(p.y) * half_edge,
                             static_cast<double>(p.z) * half_edge});
    };
    slot.edge_length = length(world(element.v[1] - element.v[0]));
    for (std::size_t end = 0; end < 2; ++end) {
        Simplex child;
        child.flat = flat_;
        child.vertices = element.vertices;
        for (std::size_t i = 0; i < 4; ++i) {
            child.v[i] = world(element.v[i]);
        }
        child.v[end] = {0, 0, 0};  // the node itself
        const double volume = child.measure();
        const double gradient = length(child.gradient_weights()[end]);
        slot.volume += volume;
        slot.grad_linf = std::max(slot.grad_linf, gradient);
        slot.grad_l1 += volume * gradient;
        slot.grad_l2 += volume * gradient * gradient;
    }
}

bool OffsetNorms::is_offset_norm(Indicator indicator) {
    return indicator <= Indicator::grad_edge && indicator != Indicator::deviation;
}

double OffsetNorms::factor(Indicator indicator, int slot, int cubes) const {
    return factor(indicator, slots_[static_cast<std::size_t>(slot)], cubes);
}

double OffsetNorms::factor(Indicator indicator, const Int3& owner, int slot,
                           const Int3& cells) const {
    const Int3 o = slot_offset(slot);
    std::size_t at =
        static_cast<std::size_t>((owner.x & 1) + 2 * (owner.y & 1) + 4 * (owner.z & 1)) &
        ~std::size_t{flat_};
    at = at * kSlots + static_cast<std::size_t>(slot);
    for (const int axis : {2, 1, 0}) {
        const bool alone = o[axis] != 0 || ((flat_ >> static_cast<unsigned>(axis)) & 1U) != 0;
        const std::size_t sides = alone || owner[axis] == 0    ? 0
                                  : owner[axis] == cells[axis] ? 1
                                                               : 2;
        at = at * kSides + sides;
    }
    return factor(indicator, sheared_[at], 1);
}

double OffsetNorms::factor(Indicator indicator, const Slot& s, int cubes) const {
    switch (indicator) {
        case Indicator::l1:
            return cubes * s.volume / (dimension_ + 1);
        case Indicator::l2:
            return std::sqrt(cubes * s.volume) / (dimension_ + 1);
        case Indicator::grad_linf:
            return s.grad_linf;
        case Indicator::grad_l1:
            return cubes * s.grad_l1;
        case Indicator::grad_l2:
            return std::sqrt(cubes * s.grad_l2);
        case Indicator::grad_edge:
            return 2 / s.edge_length;
        default:
            return 1;
    }
}

template <class Real>
void OffsetNorms::scale(Indicator indicator, const LayerRange& range, std::int64_t k, int first,
                        int last, Layer<Real>& layer) const {
    for (int slot = first; slot <= last; ++slot) {
        const Int3 o = slot_offset(slot);
        if ((static_cast<unsigned>(slot + 1) & flat_) != 0) {
            continue;
        }
        // Two cubes along every even axis; one if the node lies on the border.
        const auto along = [&](int axis, std::int64_t at) {
            const bool flat = ((flat_ >> static_cast<unsigned>(axis)) & 1U) != 0;
            return o[axis] != 0 || flat || at == 0 || at == range.cells[axis] ? 1 : 2;
        };
        const auto rounded = [&](int cubes) {
            constexpr double kUp = 4 * static_cast<double>(std::numeric_limits<Real>::epsilon());
            return static_cast<Real>(factor(indicator, slot, cubes) * (1 + kUp));
        };
        for (std::int64_t j = 0; j < range.count(1, static_cast<int>(o.y)); ++j) {
            const int yz = along(1, range.lo.y + j) * along(2, k);
            const std::array<Real, 2> factors{rounded(yz), rounded(2 * yz)};
            Real* const row = layer.row(slot, j);
            const std::int64_t n = range.count(0, static_cast<int>(o.x));
            for (std::int64_t i = 0; !sheared_.empty() && i < n; ++i) {
                constexpr double kUp =
                    4 * static_cast<double>(std::numeric_limits<Real>::epsilon());
                const Int3 owner{range.lo.x + i, range.lo.y + j, k};
                row[i] *=
                    static_cast<Real>(factor(indicator, owner, slot, range.cells) * (1 + kUp));
            }
            if (!sheared_.empty()) {
                continue;
            }
            for (std::int64_t i = 0; i < n; ++i) {
                row[i] *= factors[static_cast<std::size_t>(along(0, range.lo.x + i) - 1)];
            }
        }
    }
}

template void OffsetNorms::scale(Indicator, const LayerRange&, std::int64_t, int, int,
                                 Layer<float>&) const;
template void OffsetNorms::scale(Indicator, const LayerRange&, std::int64_t, int, int,
                                 Layer<double>&) const;

}  // namespace isonest::detail
