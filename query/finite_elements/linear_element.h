// Linear functions on the elements of the nested grid: derivatives along the axes, local products.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7 (SimplexAction: local matrix, local product,
// update). In an element of kind k the vertices v0 .. v(D-k) walk along axes; each later vertex is
// the midpoint of an edge that was bisected. So each partial derivative is a difference of few
// values: the step from the midpoint of an edge to a vertex is half an edge long and runs along an
// axis.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include <isonest/int3.h>

namespace isonest::detail {

/// For each direction (the axes in the element's own order), the weights of the vertices whose
/// weighted sum is the derivative times the edge length 2^level.
template <int D, int Kind>
constexpr auto derivative_weights() {
    static_assert(D >= 1 && D <= 3 && Kind >= 0 && Kind < D);
    std::array<std::array<int, static_cast<std::size_t>(D) + 1>, static_cast<std::size_t>(D)> w{};
    w[0] = {-1, 1};
    if constexpr (D == 2) {
        w[1] = Kind == 0 ? std::array{0, -1, 1} : std::array{-1, -1, 2};
    } else if constexpr (D == 3) {
        w[1] = Kind == 2 ? std::array{-1, -1, 2, 0} : std::array{0, -1, 1, 0};
        w[2] = Kind == 0   ? std::array{0, 0, -1, 1}
               : Kind == 1 ? std::array{-1, 0, -1, 2}
                           : std::array{0, 0, -2, 2};
    }
    return w;
}

namespace linear_element {

/// weight * x without a multiplication for 1, 0 or -1.
template <int Weight, class Real>
constexpr Real times(const Real& x) {
    if constexpr (Weight == 1) {
        return x;
    } else if constexpr (Weight == -1) {
        return -x;
    } else {
        return static_cast<Real>(Weight) * x;
    }
}

template <int D, int Kind, std::size_t Direction, class Real, std::size_t... I>
constexpr Real sum(const std::array<Real, static_cast<std::size_t>(D) + 1>& value,
                   std::index_sequence<I...>) {
    constexpr auto kWeights = derivative_weights<D, Kind>()[Direction];
    Real out{};
    const auto add = [&]<std::size_t J>() {
        if constexpr (kWeights[J] != 0) {
            out += times<kWeights[J]>(value[J]);
        }
    };
    (add.template operator()<I>(), ...);
    return out;
}

template <int D, int Kind, std::size_t Direction, class Real, std::size_t... I>
constexpr void spread(Real flux, std::array<Real, static_cast<std::size_t>(D) + 1>& out,
                      std::index_sequence<I...>) {
    constexpr auto kWeights = derivative_weights<D, Kind>()[Direction];
    const auto add = [&]<std::size_t J>() {
        if constexpr (kWeights[J] != 0) {
            out[J] += times<kWeights[J]>(flux);
        }
    };
    (add.template operator()<I>(), ...);
}

template <int D, int Kind, std::size_t Direction, class Real, std::size_t... I>
constexpr void spread_squares(Real weight, std::array<Real, static_cast<std::size_t>(D) + 1>& out,
                              std::index_sequence<I...>) {
    constexpr auto kWeights = derivative_weights<D, Kind>()[Direction];
    const auto add = [&]<std::size_t J>() {
        if constexpr (kWeights[J] != 0) {
            out[J] += times<kWeights[J] * kWeights[J]>(weight);
        }
    };
    (add.template operator()<I>(), ...);
}

template <std::size_t... I, class F>
constexpr void each(std::index_sequence<I...>, const F& f) {
    (f.template operator()<I>(), ...);
}

}  // namespace linear_element

/// The derivatives along the element's axes in their order, times its edge length.
template <int D, int Kind, class Real>
constexpr std::array<Real, static_cast<std::size_t>(D)> differences(
    const std::array<Real, static_cast<std::size_t>(D) + 1>& value) {
    std::array<Real, static_cast<std::size_t>(D)> d{};
    linear_element::each(std::make_index_sequence<D>{}, [&]<std::size_t J>() {
        d[J] = linear_element::sum<D, Kind, J>(value, std::make_index_sequence<D + 1>{});
    });
    return d;
}

/// |grad|^2. `inverse`: 1 / (edge length)^2 along the element's axes in their order.
template <int D, int Kind, class Real>
constexpr Real gradient_squared(const std::array<Real, static_cast<std::size_t>(D) + 1>& value,
                                const std::array<Real, static_cast<std::size_t>(D)>& inverse) {
    const auto d = differences<D, Kind>(value);
    Real sum = d[0] * d[0] * inverse[0];
    for (std::size_t j = 1; j < D; ++j) {
        sum += d[j] * d[j] * inverse[j];
    }
    return sum;
}

/// out += scale times the element's stiffness matrix (of |grad|^2, per volume) times value.
template <int D, int Kind, class Real>
constexpr void add_stiffness(Real scale,
                             const std::array<Real, static_cast<std::size_t>(D)>& inverse,
                             const std::array<Real, static_cast<std::size_t>(D) + 1>& value,
                             std::array<Real, static_cast<std::size_t>(D) + 1>& out) {
    const auto d = differences<D, Kind>(value);
    linear_element::each(std::make_index_sequence<D>{}, [&]<std::size_t J>() {
        linear_element::spread<D, Kind, J>(scale * inverse[J] * d[J], out,
                                           std::make_index_sequence<D + 1>{});
    });
}

/// out += scale times the diagonal of that matrix.
template <int D, int Kind, class Real>
constexpr void add_stiffness_diagonal(Real scale,
                                      const std::array<Real, static_cast<std::size_t>(D)>& inverse,
                                      std::array<Real, static_cast<std::size_t>(D) + 1>& out) {
    linear_element::each(std::make_index_sequence<D>{}, [&]<std::size_t J>() {
        linear_element::spread_squares<D, Kind, J>(scale * inverse[J], out,
                                                   std::make_index_sequence<D + 1>{});
    });
}

/// Calls f.template operator()<I, J>(weight) for each pair I < J of vertices coupled by the
/// stiffness matrix: its entry at I and J, times scale, negated.
template <int D, int Kind, class Real, class F>
constexpr void for_couplings(Real scale,
                             const std::array<Real, static_cast<std::size_t>(D)>& inverse,
                             const F& f) {
    const auto couple = [&]<std::size_t I, std::size_t J>() {
        constexpr auto kProducts = [] {
            std::array<int, static_cast<std::size_t>(D)> products{};
            for (std::size_t d = 0; d < D; ++d) {
                products[d] =
                    -derivative_weights<D, Kind>()[d][I] * derivative_weights<D, Kind>()[d][J];
            }
            return products;
        }();
        if constexpr (kProducts != std::array<int, static_cast<std::size_t>(D)>{}) {
            Real sum{};
            linear_element::each(std::make_index_sequence<D>{}, [&]<std::size_t Direction>() {
                if constexpr (kProducts[Direction] != 0) {
                    sum += linear_element::times<kProducts[Direction]>(inverse[Direction]);
                }
            });
            f.template operator()<I, J>(scale * sum);
        }
    };
    linear_element::each(std::make_index_sequence<D + 1>{}, [&]<std::size_t J>() {
        linear_element::each(std::make_index_sequence<J>{},
                             [&]<std::size_t I>() { couple.template operator()<I, J>(); });
    });
}

/// out += volume times the element's mass matrix (1 + delta_ij) / ((D + 1) (D + 2)) times value.
template <int D, class Real>
constexpr void add_mass(Real volume, const std::array<Real, static_cast<std::size_t>(D) + 1>& value,
                        std::array<Real, static_cast<std::size_t>(D) + 1>& out) {
    Real sum = value[0];
    for (std::size_t i = 1; i <= D; ++i) {
        sum += value[i];
    }
    const Real part = volume / static_cast<Real>((D + 1) * (D + 2));
    for (std::size_t i = 0; i <= D; ++i) {
        out[i] += part * (sum + value[i]);
    }
}

/// How the axes of an element change for its second half; the first half keeps them.
template <int D, int Kind>
constexpr std::array<int, static_cast<std::size_t>(D)> axes_of_second_half(
    const std::array<int, static_cast<std::size_t>(D)>& axes) {
    if constexpr (D == 2 && Kind == 0) {
        return {axes[1], axes[0]};
    } else if constexpr (D == 3 && Kind == 0) {
        return {axes[1], axes[2], axes[0]};
    } else if constexpr (D == 3 && Kind == 1) {
        return {axes[1], axes[0], axes[2]};
    } else {
        return axes;
    }
}

}  // namespace isonest::detail
