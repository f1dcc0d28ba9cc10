#include "preprocess/deviation.h"

#include "preprocess/row_kernels.h"

namespace isonest {

template <class Real>
const std::vector<typename DeviationKernel<Real>::Step>& DeviationKernel<Real>::steps(int slot,
                                                                                      int px,
                                                                                      int py,
                                                                                      int pz) {
    std::vector<Step>& steps = steps_[static_cast<std::size_t>(slot * 8 + px + 2 * py + 4 * pz)];
    if (steps.empty()) {
        const std::int64_t row = kPhases * groups_;
        const auto place = [&](const Int3& p) {
            return ((4 * pz + p.z) & (kRing - 1)) * rows_ * row + p.y * row +
                   lane_offset(p.x, px, groups_);
        };
        for (const DeviationSupport::Point& point : deviation_support(slot, px, py, pz).points) {
            Step step;
            step.at = point.at;
            step.value = place(point.at);
            step.valid = lane_offset(point.at.x, px, groups_);
            for (const DeviationSupport::Term& term : point.terms) {
                const auto t = static_cast<std::size_t>(step.terms++);
                step.term[t] = place(term.at);
                step.weight[t] = static_cast<Real>(term.weight);
            }
            steps.push_back(step);
        }
    }
    return steps;
}

template <class Real>
void DeviationKernel<Real>::row(int slot, int px, std::int64_t y, std::int64_t k,
                                std::int64_t lanes) {
    const int py = static_cast<int>(y & 1);
    const int pz = static_cast<int>(k & 1);
    const std::vector<Step>& points = steps(slot, px, py, pz);
    const auto n = static_cast<std::size_t>(lanes);
    const bool with_fine = !fine_.empty();
    best_.assign(n, Real{0});
    errors_.resize(with_fine ? n * points.size() : 0);
    const Real* const base = values_.data() + (4 * y - low_y()) * kPhases * groups_;
    for (std::size_t p = 0; p < points.size(); ++p) {
        const Step& step = points[p];
        const std::int64_t at_y = 4 * y + step.at.y;
        const std::int64_t at_z = 4 * k + step.at.z;
        const bool outside = at_y < 0 || at_y > fine_cells_.y || at_z < 0 || at_z > fine_cells_.z;
        if (outside || step.terms == 0) {
            if (with_fine) {
                std::fill_n(errors_.data() + p * n, n, Real{0});
            }
            continue;
        }
        Interpolation<Real> d;
        d.value = base + step.value;
        d.terms = step.terms;
        for (std::size_t t = 0; t < 4; ++t) {
            d.term[t] = base + step.term[t];
            d.weight[t] = step.weight[t];
        }
        if (with_fine) {
            differences(d, errors_.data() + p * n, lanes);
        } else {
            raise_differences(d, valid_.data() + step.valid, best_.data(), lanes);
        }
    }
    if (!with_fine) {
        return;
    }
    largest_.resize(n);
    for (const DeviationSupport::Cube& cube : deviation_support(slot, px, py, pz).cubes) {
        const std::int64_t cy = 4 * y + cube.low.y;
        const std::int64_t cz = 4 * k + cube.low.z;
        if (cy < 0 || cy >= fine_cells_.y || cz < 0 || cz >= fine_cells_.z) {
            continue;
        }
        std::fill(largest_.begin(), largest_.end(), Real{0});
        for (const std::uint16_t p : cube.points) {
            raise(errors_.data() + p * n, largest_.data(), lanes);
        }
        raise_sum(largest_.data(),
                  fine_.data() + row_start(cy, cz) + lane_offset(cube.low.x, px, groups_),
                  best_.data(), lanes);
    }
}

template class DeviationKernel<float>;
template class DeviationKernel<double>;

}  // namespace isonest
