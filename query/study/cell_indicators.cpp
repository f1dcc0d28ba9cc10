#include "query/study/cell_indicators.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace isonest::detail {
namespace {

constexpr float kMissing = std::numeric_limits<float>::infinity();
constexpr Int3 kThree{3, 3, 3};

/// U_delta on one cell: U at the nodes of its refinement minus the function that is d-linear
/// between its corners. Positions are x + 3 y + 9 z in half edges, 0 along flat axes.
class CellOffsets {
  public:
    /// `axes`: 1 along the axes that are not flat. `half`: half an edge in world units.
    CellOffsets(const Int3& axes, const Double3& half) : axes_(axes), half_(half) {
        for (std::int64_t i = 0; i < kThree.product(); ++i) {
            const Int3 o = kThree.unlinear(i);
            if (min(o, axes * 2) == o) {
                nodes_.push_back(o);
            }
        }
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 o = Int3{2, 2, 2}.unlinear(i);
            if (min(o, axes) == o) {
                corners_.push_back(o);
            }
        }
        for (std::size_t a = 0; a < 3; ++a) {
            size_ *= axes[static_cast<int>(a)] != 0 ? half[a] : 1;
        }
    }

    /// Returns false if a value is missing.
    bool load(const WholeLattice& whole, const Int3& low, std::int64_t step) {
        for (const Int3& o : nodes_) {
            number(o) = whole.exact(low + o * step);
            if (!std::isfinite(number(o))) {
                return false;
            }
        }
        const std::array<double, 27> u = offset_;
        for (const Int3& o : nodes_) {
            double linear = 0;
            for (const Int3& corner : corners_) {
                double weight = 1;
                for (int axis = 0; axis < 3; ++axis) {
                    const double t = static_cast<double>(o[axis]) / 2;
                    weight *= corner[axis] != 0 ? t : 1 - t;
                }
                linear += weight * u[position(corner * 2)];
            }
            number(o) -= linear;
        }
        return true;
    }

    /// Its norm, with lumped mass: a node has the integral of its hat function.
    [[nodiscard]] double norm(double power) const {
        double sum = 0;
        double most = 0;
        for (const Int3& o : nodes_) {
            double weight = size_;
            for (int axis = 0; axis < 3; ++axis) {
                weight *= axes_[axis] != 0 && o[axis] != 1 ? 0.5 : 1;
            }
            const double d = std::fabs(offset_[position(o)]);
            most = std::max(most, d);
            sum += std::isinf(power) ? 0 : weight * std::pow(d, power);
        }
        return std::isinf(power) ? most : std::pow(sum, 1 / power);
    }

    /// The norm of its gradient, by the gradients at the corners of the cell's children: there they
    /// are largest.
    [[nodiscard]] double gradient_norm(double power) const {
        double sum = 0;
        double most = 0;
        for (const Int3& child : corners_) {
            for (const Int3& corner : corners_) {
                double square = 0;
                for (int axis = 0; axis < 3; ++axis) {
                    if (axes_[axis] != 0) {
                        Int3 low = child + corner;
                        low[axis] = child[axis];
                        Int3 high = low;
                        ++high[axis];
                        const double slope = (offset_[position(high)] - offset_[position(low)]) /
                                             half_[static_cast<std::size_t>(axis)];
                        square += slope * slope;
                    }
                }
                const double slope = std::sqrt(square);
                most = std::max(most, slope);
                sum += std::isinf(power) ? 0 : std::pow(slope, power);
            }
        }
        const double weight = size_ / static_cast<double>(corners_.size());
        return std::isinf(power) ? most : std::pow(weight * sum, 1 / power);
    }

  private:
    static std::size_t position(const Int3& o) {
        return static_cast<std::size_t>(kThree.linear(o));
    }
    double& number(const Int3& o) { return offset_[position(o)]; }

    Int3 axes_;
    Double3 half_;
    std::vector<Int3> nodes_;
    std::vector<Int3> corners_;
    double size_ = 1;  ///< of a child
    std::array<double, 27> offset_{};
};

/// The largest number of the cells of the finer level around a cell.
float largest_of_children(const WholeLattice& whole, int level, const Int3& cell,
                          const Int3& axes) {
    const Lattice& lattice = whole.lattice();
    const Int3 first = max(cell * 2 - axes, {0, 0, 0});
    const Int3 last = min(cell * 2 + axes * 2, lattice.elements_at(level - 1) - Int3{1, 1, 1});
    const Int3 count = last - first + Int3{1, 1, 1};
    float most = 0;
    for (std::int64_t i = 0; i < count.product(); ++i) {
        most = std::max(most,
                        whole.indicator(lattice.centre_of(level - 1, first + count.unlinear(i))));
    }
    return most;
}

}  // namespace

double compute_cell_indicator(WholeLattice& whole, const ComputedField& field,
                              const Double3& spacing, Progress& progress) {
    const Lattice& lattice = whole.lattice();
    const Int3 axes = min(lattice.nodes() - Int3{1, 1, 1}, {1, 1, 1});
    double largest = 0;
    for (int level = 1; level <= lattice.top(); ++level) {
        const Int3 cells = lattice.elements_at(level);
        const std::int64_t step = std::int64_t{1} << (level - 1);
        Double3 half{};
        for (std::size_t a = 0; a < 3; ++a) {
            half[a] = static_cast<double>(step) * spacing[a];
        }
        std::vector<float> rows(static_cast<std::size_t>(cells.y * cells.z), 0);
        tbb::parallel_for(std::int64_t{0}, cells.y * cells.z, [&](std::int64_t row) {
            progress.check();
            CellOffsets offsets(axes, half);
            float& most = rows[static_cast<std::size_t>(row)];
            for (std::int64_t x = 0; x < cells.x; ++x) {
                const Int3 cell{x, row % cells.y, row / cells.y};
                float eta = kMissing;
                if (offsets.load(whole, cell * (2 * step), step)) {
                    const double own = field.indicator == ComputedIndicator::hex_lp
                                           ? offsets.norm(field.power)
                                           : offsets.gradient_norm(field.power);
                    eta = std::isfinite(own) ? static_cast<float>(own) : kMissing;
                }
                if (field.saturation && level > 1) {
                    const float children = largest_of_children(whole, level, cell, axes);
                    eta = *field.saturation == Saturation::bar ? std::max(eta, children)
                                                               : eta + children;
                }
                whole.set_indicator(lattice.centre_of(level, cell), eta);
                most = std::isfinite(eta) ? std::max(most, eta) : most;
            }
        });
        largest =
            std::max(largest, static_cast<double>(*std::max_element(rows.begin(), rows.end())));
    }
    return largest;
}

}  // namespace isonest::detail
