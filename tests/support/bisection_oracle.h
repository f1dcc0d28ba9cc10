// Indicators by explicit recursive bisection, without the closed form of the lattice.
//
// Source: Maubach's tagged bisection (1995) in d dimensions: a simplex (v0 .. vd; k) is cut at the
// midpoint z of v0 vk into (v0 .. v(k-1), z, v(k+1) ..; k') and (v1 .. vk, z, v(k+1) ..; k'), k' =
// k - 1, or d if k = 1.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <span>
#include <vector>

#include <isonest/field.h>

#include "store/lattice/lattice.h"

namespace isonest::detail::test {

struct OracleNode {
    /// Indexed by Indicator; not saturated, and saturated by maximum and by sum.
    std::array<double, kIndicatorCount> eta{};
    std::array<double, kIndicatorCount> bar{};
    std::array<double, kIndicatorCount> plus{};
    /// The same for BisectionOracle::OwnMeasure.
    double own_eta = 0;
    double own_bar = 0;
    double own_plus = 0;

    [[nodiscard]] double of(Field field) const {
        if (is_own(field)) {
            return saturation_of(field) == Saturation::bar ? own_bar : own_plus;
        }
        const auto i = static_cast<std::size_t>(indicator_of(field));
        return saturation_of(field) == Saturation::bar ? bar[i] : plus[i];
    }
};

class BisectionOracle {
  public:
    using Key = std::array<std::int64_t, 3>;
    /// A number of an element that is bisected at node x; an own indicator is the largest around x.
    /// Not called for elements with a missing value.
    using OwnMeasure = std::function<double(std::span<const Int3> vertices, const Int3& x)>;
    /// `value` gives U, clamped outside. A non-finite value is missing. Axes with one node are
    /// omitted: the elements are then triangles or edges.
    BisectionOracle(const Int3& n, std::function<double(const Int3&)> value,
                    const Double3& spacing = {1, 1, 1}, const OwnMeasure& own = {});
    [[nodiscard]] const std::map<Key, OracleNode>& nodes() const { return nodes_; }

  private:
    struct Element {
        std::array<Int3, 4> v;
        int tag;
    };
    using Gradient = std::array<double, 3>;

    [[nodiscard]] Int3 middle(const Element& t) const;
    [[nodiscard]] std::array<Element, 2> bisect(const Element& t) const;
    [[nodiscard]] bool exists(const Element& t) const;
    /// The barycentric coordinates of a point, and the size of the element.
    [[nodiscard]] std::array<double, 4> barycentric(const Element& t, const Gradient& p) const;
    [[nodiscard]] double measure(const Element& t) const;
    [[nodiscard]] Gradient gradient(const Element& t, const std::array<double, 4>& u) const;
    /// The unit normal of the face that the two children of t share.
    [[nodiscard]] Gradient normal_between_children(const Element& t) const;
    [[nodiscard]] double deviation(const Element& t) const;
    [[nodiscard]] double determinant(const std::array<Gradient, 3>& rows) const;
    [[nodiscard]] std::array<Gradient, 3> edges(const Element& t) const;

    Int3 n_;
    std::function<double(const Int3&)> value_;
    Double3 spacing_;
    std::vector<int> axes_;  ///< axes that are not flat
    std::size_t d_ = 3;
    std::map<Key, OracleNode> nodes_;
};

}  // namespace isonest::detail::test
