#include "preprocess/indicators/deviation.h"

#include <algorithm>
#include <limits>

#include "preprocess/indicators/row_kernels.h"

namespace isonest::detail {

template <class Real>
DeviationKernel<Real>::DeviationKernel(const LayerRange& range, const Int3& fine_cells,
                                       bool with_fine, unsigned flat, bool outward)
    : range_(range), fine_cells_(fine_cells), flat_(flat), outward_(outward) {
    for (int axis = 0; axis < 2; ++axis) {
        groups_[axis] = (4 * (range.hi[axis] - range.lo[axis]) + 2 + kPhases) / kPhases + 1;
    }
    groups_.z = 1;
    values_.resize(static_cast<std::size_t>(kRing * plane_size()));
    fine_.resize(with_fine ? values_.size() : 0);
    const bool inside =
        low_x() >= 0 && high_x() <= fine_cells.x && low_y() >= 0 && high_y() <= fine_cells.y;
    if (inside) {
        return;
    }
    valid_.resize(static_cast<std::size_t>(plane_size()));
    line_.resize(static_cast<std::size_t>(high_x() - low_x() + 1));
    for (std::int64_t y = low_y(); y <= high_y(); ++y) {
        for (std::int64_t x = low_x(); x <= high_x(); ++x) {
            const bool valid = x >= 0 && x <= fine_cells.x && y >= 0 && y <= fine_cells.y;
            line_[static_cast<std::size_t>(x - low_x())] =
                valid ? Real{0} : std::numeric_limits<Real>::quiet_NaN();
        }
        scatter(valid_.data(), y);
    }
}

template <class Real>
std::int64_t DeviationKernel<Real>::place(std::int64_t at_x, std::int64_t at_y) const {
    const std::int64_t x = at_x + kPhases;
    const std::int64_t y = at_y + kPhases;
    return ((y % kPhases) * kPhases + x % kPhases) * groups_.product() + (y / kPhases) * groups_.x +
           x / kPhases;
}

template <class Real>
void DeviationKernel<Real>::scatter(Real* plane, std::int64_t y) const {
    const auto n = static_cast<std::int64_t>(line_.size());
    for (std::int64_t i = 0; i < std::min(n, kPhases); ++i) {
        Real* out = plane + place(i - 2, y - 4 * range_.lo.y);
        for (std::int64_t x = i; x < n; x += kPhases) {
            *out++ = line_[static_cast<std::size_t>(x)];
        }
    }
}

template <class Real>
const std::vector<typename DeviationKernel<Real>::Step>& DeviationKernel<Real>::steps(
    const Lanes& lanes, int pz) {
    std::vector<Step>& steps =
        steps_[static_cast<std::size_t>(lanes.slot * 8 + lanes.px + 2 * lanes.py + 4 * pz)];
    if (steps.empty()) {
        const auto in_plane = [&](const Int3& p) {
            return place(4 * lanes.px + p.x, 4 * lanes.first + p.y);
        };
        for (const DeviationSupport::Point& point :
             deviation_support(lanes.slot, lanes.px, lanes.py, pz, flat_).points) {
            Step step;
            step.z = point.at.z;
            step.value = ring_start(4 * pz + point.at.z) + in_plane(point.at);
            step.valid = in_plane(point.at);
            const auto add = [&](const Int3& at, double weight) {
                const auto t = static_cast<std::size_t>(step.terms++);
                step.term.at(t) = ring_start(4 * pz + at.z) + in_plane(at);
                step.weight.at(t) = static_cast<Real>(weight);
            };
            for (const DeviationSupport::Term& term : point.terms) {
                // Weights are quarters, and sum up to 1: these are at most four powers of two.
                const bool split = outward_ && term.weight == 0.75;
                add(term.at, split ? 0.5 : term.weight);
                if (split) {
                    add(term.at, 0.25);
                }
            }
            steps.push_back(step);
        }
    }
    return steps;
}

/// Raises best_ by the differences at the support's points or, where the finer level has deviations
/// of its own, keeps the differences in errors_, point by point.
template <class Real>
void DeviationKernel<Real>::raise_points(const Lanes& lanes, std::int64_t k) {
    const std::vector<Step>& points = steps(lanes, static_cast<int>(k & 1));
    const auto n = static_cast<std::size_t>(lanes.count);
    best_.assign(n, Real{0});
    errors_.resize(fine_.empty() ? 0 : n * points.size());
    const Real* const base = values_.data();
    for (std::size_t p = 0; p < points.size(); ++p) {
        const Step& step = points[p];
        const std::int64_t z = 4 * k + step.z;
        if (step.terms == 0 || z < 0 || z > fine_cells_.z) {
            continue;
        }
        Interpolation<Real> d;
        d.value = base + step.value;
        d.terms = step.terms;
        d.outward = outward_;
        for (std::size_t t = 0; t < 4; ++t) {
            d.term[t] = base + step.term[t];
            d.weight[t] = step.weight[t];
        }
        if (!fine_.empty()) {
            differences(d, errors_.data() + p * n, lanes.count);
        } else {
            raise_differences(d, valid_.empty() ? nullptr : valid_.data() + step.valid,
                              best_.data(), lanes.count);
        }
    }
}

/// Raises best_ by the largest difference at each finer cube's vertices plus the cube's deviation.
template <class Real>
void DeviationKernel<Real>::raise_cubes(const Lanes& lanes, std::int64_t k) {
    const auto pz = static_cast<int>(k & 1);
    const std::vector<Step>& points = steps(lanes, pz);
    const auto n = static_cast<std::size_t>(lanes.count);
    for (const DeviationSupport::Cube& cube :
         deviation_support(lanes.slot, lanes.px, lanes.py, pz, flat_).cubes) {
        const std::int64_t z = 4 * k + cube.low.z;
        if (z < 0 || z >= std::max<std::int64_t>(fine_cells_.z, 1)) {
            continue;
        }
        largest_.assign(n, Real{0});
        for (const std::uint16_t p : cube.points) {
            if (points[p].terms != 0) {
                raise(errors_.data() + p * n, largest_.data(), lanes.count);
            }
        }
        raise_sum(largest_.data(),
                  fine_.data() + ring_start(z) +
                      place(4 * lanes.px + cube.low.x, 4 * lanes.first + cube.low.y),
                  best_.data(), lanes.count);
    }
}

template <class Real>
void DeviationKernel<Real>::layer(std::int64_t k, int first_slot, int last_slot, Layer<Real>& out) {
    for (int slot = first_slot; slot <= last_slot; ++slot) {
        const Int3 o = slot_offset(slot);
        if ((static_cast<unsigned>(slot + 1) & flat_) != 0) {
            continue;
        }
        for (int parity = 0; parity < 4; ++parity) {
            Lanes lanes{slot, parity & 1, parity >> 1, 0, 0};
            lanes.first = (lanes.py ^ range_.lo.y) & 1;
            const std::int64_t rows =
                (range_.count(1, static_cast<int>(o.y)) - lanes.first + 1) / 2;
            const std::int64_t columns =
                (range_.count(0, static_cast<int>(o.x)) - lanes.px + 1) / 2;
            if (rows <= 0 || columns <= 0) {
                continue;
            }
            lanes.count = (rows - 1) * groups_.x + columns;
            raise_points(lanes, k);
            if (!fine_.empty()) {
                raise_cubes(lanes, k);
            }
            for (std::int64_t j = 0; j < rows; ++j) {
                Real* const to = out.row(slot, lanes.first + 2 * j) + lanes.px;
                const Real* const from = best_.data() + j * groups_.x;
                for (std::int64_t i = 0; i < columns; ++i) {
                    to[2 * i] = from[i];
                }
            }
        }
    }
}

template class DeviationKernel<float>;
template class DeviationKernel<double>;

}  // namespace isonest::detail
