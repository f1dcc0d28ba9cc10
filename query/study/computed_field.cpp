#include "query/study/computed_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "query/traverse/element.h"
#include "store/base/vector3.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The odd axes of a node of scale 1 (bits).
unsigned odd_axes(const Int3& p) {
    return static_cast<unsigned>((p.x & 1) | (p.y & 1) << 1 | (p.z & 1) << 2);
}

/// Calls f(t, children) for all elements between the one cube of `lattice` and its subcubes.
template <int D, class F>
void for_bisections(const Lattice& lattice, const F& f) {
    std::vector<Element<D>> left = coarsest_elements<D>(lattice);
    while (!left.empty()) {
        const Element<D> t = left.back();
        left.pop_back();
        if (t.level == 0) {
            continue;
        }
        const std::array<Element<D>, 2> halves = t.bisect(0);
        f(t, halves);
        left.insert(left.end(), halves.begin(), halves.end());
    }
}

template <int D>
Simplex simplex_of(const Element<D>& t, const Double3& spacing, unsigned flat) {
    Simplex simplex;
    simplex.vertices = D + 1;
    simplex.flat = flat;
    for (std::size_t i = 0; i < t.v.size(); ++i) {
        for (std::size_t a = 0; a < 3; ++a) {
            simplex.v[i][a] = static_cast<double>(t.v[i][static_cast<int>(a)]) * spacing[a];
        }
    }
    return simplex;
}

/// Of the elements that refine at those nodes of a cube of edge 2 whose even coordinates are 0: the
/// others are mirror images.
template <int D>
void sum_factors(const Lattice& lattice, const Double3& spacing, double power,
                 std::array<double, 8>& size, std::array<double, 8>& hat) {
    const Int3 nodes{lattice.nodes().x > 1 ? 3 : 1, lattice.nodes().y > 1 ? 3 : 1,
                     lattice.nodes().z > 1 ? 3 : 1};
    const Lattice cube(nodes);
    for_bisections<D>(cube, [&](const Element<D>& t, const std::array<Element<D>, 2>& halves) {
        const Int3 x = t.ref_node();
        if (std::max({x.x, x.y, x.z}) > 1) {
            return;
        }
        const unsigned odd = odd_axes(x);
        size[odd] += simplex_of(t, spacing, lattice.flat_axes()).measure();
        for (const Element<D>& half : halves) {
            const Simplex simplex = simplex_of(half, spacing, lattice.flat_axes());
            const auto vertex = static_cast<std::size_t>(
                std::find(half.v.begin(), half.v.end(), x) - half.v.begin());
            const double slope = length(simplex.gradient_weights()[vertex]);
            if (std::isinf(power)) {
                hat[odd] = std::max(hat[odd], slope);
            } else {
                hat[odd] += simplex.measure() * std::pow(slope, power);
            }
        }
    });
}

}  // namespace

std::optional<ComputedField> computed_field_from_name(std::string_view name) {
    ComputedField field;
    for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
        const std::string_view end = saturation == Saturation::bar ? "_bar" : "_plus";
        if (name.ends_with(end)) {
            field.saturation = saturation;
            name.remove_suffix(end.size());
            break;
        }
    }
    if (name == "gradient" || name == "curvature") {
        field.indicator =
            name == "gradient" ? ComputedIndicator::gradient : ComputedIndicator::curvature;
        return field;
    }
    const std::string_view lp = "lp:";
    const std::string_view grad = "grad_lp:";
    if (!name.starts_with(lp) && !name.starts_with(grad)) {
        return std::nullopt;
    }
    field.indicator = name.starts_with(lp) ? ComputedIndicator::lp : ComputedIndicator::grad_lp;
    name.remove_prefix(name.starts_with(lp) ? lp.size() : grad.size());
    if (name == "inf") {
        field.power = kInfinity;
        return field;
    }
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), field.power);
    const bool is_number = error == std::errc() && end == name.data() + name.size();
    if (!is_number || !(field.power >= 1) || !std::isfinite(field.power)) {
        return std::nullopt;
    }
    return field;
}

std::string name_of(const ComputedField& field) {
    std::string name;
    switch (field.indicator) {
        case ComputedIndicator::lp:
            name = fmt::format("lp:{}", field.power);
            break;
        case ComputedIndicator::grad_lp:
            name = fmt::format("grad_lp:{}", field.power);
            break;
        case ComputedIndicator::gradient:
            name = "gradient";
            break;
        case ComputedIndicator::curvature:
            name = "curvature";
            break;
    }
    if (field.saturation) {
        name += *field.saturation == Saturation::bar ? "_bar" : "_plus";
    }
    return name;
}

OffsetFactors::OffsetFactors(const Lattice& lattice, const Double3& spacing,
                             const ComputedField& field)
    : lattice_(lattice),
      power_(field.power),
      gradient_(field.indicator == ComputedIndicator::grad_lp),
      dimension_(lattice.dimension()) {
    switch (dimension_) {
        case 1:
            sum_factors<1>(lattice, spacing, power_, size_, hat_);
            break;
        case 2:
            sum_factors<2>(lattice, spacing, power_, size_, hat_);
            break;
        default:
            sum_factors<3>(lattice, spacing, power_, size_, hat_);
    }
}

double OffsetFactors::of(const Int3& p, const NodeInfo& node) const {
    const Int3 cells = lattice_.cells_at(node.level());
    std::int64_t cubes = 1;
    unsigned odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        odd |= node.odd[a] ? 1U << a : 0;
        if (!node.odd[a] && cells[axis] > 0) {
            // Those before the node and after it.
            const std::int64_t at = p[axis] / (2 * node.scale);
            cubes *= (at > 0 ? 1 : 0) + (at < cells[axis] ? 1 : 0);
        }
    }
    const auto count = static_cast<double>(cubes);
    const auto scale = static_cast<double>(node.scale);
    if (std::isinf(power_)) {
        return gradient_ ? hat_[odd] / scale : 1;
    }
    if (gradient_) {
        return std::pow(count * hat_[odd] * std::pow(scale, dimension_ - power_), 1 / power_);
    }
    return std::pow(count * size_[odd] * std::pow(scale, dimension_), 1 / power_) /
           (dimension_ + 1);
}

}  // namespace isonest::detail
