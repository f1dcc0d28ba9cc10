#include "preprocess/indicators/offset_norms.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "preprocess/indicators/diamond.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {

OffsetNorms::OffsetNorms(const Double3& spacing, int level, unsigned flat)
    : flat_(flat), dimension_(3 - std::popcount(flat)) {
    const double half_edge = std::ldexp(1.0, level - 1);
    const auto world = [&](const Int3& p) {
        Double3 out{};
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            out[a] = static_cast<double>(p[axis]) * half_edge * spacing[a];
        }
        return out;
    };
    for (int s = 0; s < kSlots; ++s) {
        if ((static_cast<unsigned>(s + 1) & flat) != 0) {
            continue;
        }
        Slot& slot = slots_[static_cast<std::size_t>(s)];
        for (const DiamondElement& element : diamond(s, 0, flat)) {
            if (element.cube != Int3{0, 0, 0}) {
                continue;
            }
            const Int3 along = element.v[1] - element.v[0];
            slot.edge_length = length(world(along));
            for (std::size_t end = 0; end < 2; ++end) {
                Simplex child;
                child.flat = flat;
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
    }
}

bool OffsetNorms::is_offset_norm(Indicator indicator) {
    return indicator <= Indicator::grad_edge && indicator != Indicator::deviation;
}

double OffsetNorms::factor(Indicator indicator, int slot, int cubes) const {
    const Slot& s = slots_[static_cast<std::size_t>(slot)];
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
        // Two cubes along every even axis, one where the node lies on the border.
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
