#include "preprocess/indicators/normal_indicators.h"

#include <cmath>
#include <limits>

#include "preprocess/indicators/offset_norms.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kNode = 13;

Double3 gradient(const std::array<Double3, 4>& weights, const std::array<double, 4>& values) {
    Double3 g{};
    for (std::size_t i = 0; i < 4; ++i) {
        for (std::size_t a = 0; a < 3; ++a) {
            // Differences from the first value: the gradient of a constant is exactly 0.
            g[a] += weights[i][a] * (values[i] - values[0]);
        }
    }
    return g;
}

Double3 unit(const Double3& g) {
    const double size = length(g);
    return size > 0 ? Double3{g[0] / size, g[1] / size, g[2] / size} : Double3{};
}

Double3 difference(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double distance(const Double3& a, const Double3& b) {
    return length(difference(a, b));
}

}  // namespace

NormalIndicators::NormalIndicators(const LatticeSteps& steps, int level, unsigned flat)
    : flat_(flat) {
    const double half_edge = std::ldexp(1.0, level - 1);
    for (unsigned parities = 0; parities < 8; ++parities) {
        for (int slot = 0; slot < kSlots; ++slot) {
            if (((parities | static_cast<unsigned>(slot + 1)) & flat) != 0) {
                continue;
            }
            auto& table = tables_[parities * kSlots + static_cast<unsigned>(slot)];
            for (const DiamondElement& element : diamond(slot, parities, flat)) {
                Element e;
                e.vertices = element.vertices;
                e.cube = element.cube;
                Simplex whole;
                whole.flat = flat;
                whole.vertices = element.vertices;
                for (std::size_t i = 0; i < static_cast<std::size_t>(element.vertices); ++i) {
                    const Int3& v = element.v[i];
                    e.v[i] = static_cast<std::uint8_t>((v.x + 1) + 3 * (v.y + 1) + 9 * (v.z + 1));
                    whole.v[i] = steps.vector({static_cast<double>(v.x) * half_edge,
                                               static_cast<double>(v.y) * half_edge,
                                               static_cast<double>(v.z) * half_edge});
                }
                e.whole = whole.gradient_weights();
                for (std::size_t end = 0; end < 2; ++end) {
                    Simplex child = whole;
                    child.v[end] = {0, 0, 0};
                    e.children[end] = child.gradient_weights();
                }
                // In child 0, the function that is 1 at v[1] and 0 at the other vertices is 0 on
                // that face.
                e.across = unit(e.children[0][1]);
                e.edge_length = distance(whole.v[0], whole.v[1]);
                table.push_back(e);
            }
        }
    }
}

NormalChange NormalIndicators::at(const Int3& owner, int slot, const Int3& cells,
                                  const Neighbourhood& values) const {
    const auto parities =
        static_cast<unsigned>((owner.x & 1) + 2 * (owner.y & 1) + 4 * (owner.z & 1)) & ~flat_;
    NormalChange change;  // `jump` and `turn` contain squares until the largest are found
    for (const Element& e : tables_[parities * kSlots + static_cast<unsigned>(slot)]) {
        const Int3 cube = owner + e.cube;
        if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} || max(cube + Int3{1, 1, 1}, cells) != cells) {
            continue;
        }
        std::array<double, 4> u{};
        for (std::size_t i = 0; i < 4; ++i) {
            // Unused vertices have weight 0.
            u[i] = values[e.v[i < static_cast<std::size_t>(e.vertices) ? i : 0]];
        }
        const Double3 before = unit(gradient(e.whole, u));
        std::array<Double3, 2> normal{};
        double size = 0;
        for (std::size_t end = 0; end < 2; ++end) {
            std::array<double, 4> v = u;
            v[end] = values[kNode];
            const Double3 g = gradient(e.children[end], v);
            size += length(g) / 2;
            normal[end] = unit(g);
            const Double3 turn = difference(normal[end], before);
            change.turn = std::fmax(change.turn, dot(turn, turn));
        }
        const Double3 jump = difference(normal[0], normal[1]);
        change.jump = std::fmax(change.jump, dot(jump, jump));
        change.component = std::fmax(change.component, std::fabs(dot(e.across, jump)));
        const double offset = std::fabs(values[kNode] - (u[0] + u[1]) / 2);
        if (size > 0) {
            change.edge = std::fmax(change.edge, 4 * offset / e.edge_length / size);
        }
        if (!std::isfinite(size)) {
            constexpr double kInfinity = std::numeric_limits<double>::infinity();
            return {kInfinity, kInfinity, kInfinity, kInfinity};
        }
    }
    change.jump = std::sqrt(change.jump);
    change.turn = std::sqrt(change.turn);
    return change;
}

}  // namespace isonest::detail
