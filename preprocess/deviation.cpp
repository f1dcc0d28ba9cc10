#include "preprocess/deviation.h"

namespace isonest {
namespace {

/// A comparison that ignores NaN in `value`.
template <class Real>
void raise(Real* best, const Real* value, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        best[i] = value[i] > best[i] ? value[i] : best[i];
    }
}

}  // namespace

template <class Real>
void DeviationKernel<Real>::differences(const DeviationSupport::Point& point, int px,
                                        std::int64_t y, std::int64_t k, std::int64_t lanes,
                                        Real* out) const {
    const auto at = [&](const Int3& p) {
        return values_.data() + row_start(4 * y + p.y, 4 * k + p.z) +
               lane_offset(p.x, px, groups_);
    };
    const Real* const v = at(point.at);
    const auto& t = point.terms;
    const auto weight = [&](std::size_t i) { return static_cast<Real>(t[i].weight); };
    if (t.size() == 2) {
        const Real* const a = at(t[0].at);
        const Real* const b = at(t[1].at);
        const Real wa = weight(0);
        const Real wb = weight(1);
        for (std::int64_t n = 0; n < lanes; ++n) {
            out[n] = std::fabs(v[n] - (wa * a[n] + wb * b[n]));
        }
    } else if (t.size() == 3) {
        const Real* const a = at(t[0].at);
        const Real* const b = at(t[1].at);
        const Real* const c = at(t[2].at);
        const Real wa = weight(0);
        const Real wb = weight(1);
        const Real wc = weight(2);
        for (std::int64_t n = 0; n < lanes; ++n) {
            out[n] = std::fabs(v[n] - (wa * a[n] + wb * b[n] + wc * c[n]));
        }
    } else {
        const Real* const a = at(t[0].at);
        const Real* const b = at(t[1].at);
        const Real* const c = at(t[2].at);
        const Real* const d = at(t[3].at);
        const Real wa = weight(0);
        const Real wb = weight(1);
        const Real wc = weight(2);
        const Real wd = weight(3);
        for (std::int64_t n = 0; n < lanes; ++n) {
            out[n] = std::fabs(v[n] - (wa * a[n] + wb * b[n] + wc * c[n] + wd * d[n]));
        }
    }
}

template <class Real>
void DeviationKernel<Real>::row(int slot, int px, std::int64_t y, std::int64_t k,
                                std::int64_t lanes) {
    const DeviationSupport& support =
        deviation_support(slot, px, static_cast<int>(y & 1), static_cast<int>(k & 1));
    const auto n = static_cast<std::size_t>(lanes);
    best_.assign(n, Real{0});
    errors_.resize(n * (fine_.empty() ? 1 : support.points.size()));
    for (std::size_t p = 0; p < support.points.size(); ++p) {
        const DeviationSupport::Point& point = support.points[p];
        Real* const error = errors_.data() + (fine_.empty() ? 0 : p * n);
        const std::int64_t py = 4 * y + point.at.y;
        const std::int64_t pz = 4 * k + point.at.z;
        const bool outside = py < 0 || py > fine_cells_.y || pz < 0 || pz > fine_cells_.z;
        if (outside || point.terms.empty()) {
            std::fill(error, error + n, Real{0});
            continue;
        }
        differences(point, px, y, k, lanes, error);
        if (fine_.empty()) {
            const Real* const valid = valid_.data() + lane_offset(point.at.x, px, groups_);
            for (std::size_t i = 0; i < n; ++i) {
                const Real value = error[i] + valid[i];
                best_[i] = value > best_[i] ? value : best_[i];
            }
        }
    }
    if (fine_.empty()) {
        return;
    }
    largest_.resize(n);
    for (const DeviationSupport::Cube& cube : support.cubes) {
        const std::int64_t cy = 4 * y + cube.low.y;
        const std::int64_t cz = 4 * k + cube.low.z;
        if (cy < 0 || cy >= fine_cells_.y || cz < 0 || cz >= fine_cells_.z) {
            continue;
        }
        std::fill(largest_.begin(), largest_.end(), Real{0});
        for (const std::uint16_t p : cube.points) {
            raise(largest_.data(), errors_.data() + p * n, lanes);
        }
        const Real* const fine =
            fine_.data() + row_start(cy, cz) + lane_offset(cube.low.x, px, groups_);
        for (std::size_t i = 0; i < n; ++i) {
            const Real value = largest_[i] + fine[i];
            best_[i] = value > best_[i] ? value : best_[i];
        }
    }
}

template class DeviationKernel<float>;
template class DeviationKernel<double>;

}  // namespace isonest
