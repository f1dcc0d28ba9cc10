#include "preprocess/indicators/deviation.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <map>
#include <mutex>
#include <set>
#include <tuple>

#include "preprocess/indicators/offset_norms.h"
#include "preprocess/indicators/row_kernels.h"
#include "store/lattice/lattice.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t>;
Key key_of(const Int3& p) {
    return {p.z, p.y, p.x};
}

/// Barycentric coordinates of p in t times the volume; all >= 0 if and only if p lies in t.
std::array<std::int64_t, 4> barycentric(const Tetrahedron& t, const Int3& p) {
    const std::int64_t volume = determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t sign = volume < 0 ? -1 : 1;
    const std::int64_t b1 = sign * determinant(p - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t b2 = sign * determinant(t.v[1] - t.v[0], p - t.v[0], t.v[3] - t.v[0]);
    const std::int64_t b3 = sign * determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], p - t.v[0]);
    return {sign * volume - b1 - b2 - b3, b1, b2, b3};
}

/// The Kuhn tetrahedra of cubes of edge 1 inside t.
std::vector<Tetrahedron> finest(const Tetrahedron& t) {
    std::vector<Tetrahedron> level{t};
    while (true) {
        std::vector<Tetrahedron> next;
        for (const Tetrahedron& parent : level) {
            if (parent.level == 0) {
                next.push_back(parent);
                continue;
            }
            for (const Tetrahedron& child : parent.bisect()) {
                next.push_back(child);
            }
        }
        if (next.size() == level.size()) {
            return level;
        }
        level = std::move(next);
    }
}

DeviationSupport make_support(int slot, const Int3& parity, unsigned flat) {
    // A cube index with these parities, far enough from the origin that all coordinates are
    // positive.
    const Int3 cube = parity + Int3{4, 4, 4};
    const Int3 base = cube * 4;
    const Int3 node = base + slot_offset(slot) * 2;

    std::map<Key, DeviationSupport::Point> points;
    std::map<Key, std::pair<Int3, std::set<Key>>> cubes;
    const auto full = static_cast<std::size_t>(4 - std::popcount(flat));
    for (const Tetrahedron& t : tetrahedra_around(cube, 4, node, flat)) {
        for (const Tetrahedron& small : finest(t)) {
            Int3 low = small.v[0];
            for (const Int3& v : small.v) {
                low = min(low, v);
            }
            const std::vector<Int3> traced = trace(small, node, flat);
            if (traced.size() != full) {
                continue;
            }
            auto& [corner, vertices] = cubes[key_of(low)];
            corner = low - base;
            for (const Int3& v : traced) {
                vertices.insert(key_of(v));
                if (points.contains(key_of(v))) {
                    continue;
                }
                DeviationSupport::Point point{v - base, {}};
                const auto weights = barycentric(t, v);
                std::int64_t total = 0;
                for (const std::int64_t w : weights) {
                    total += w;
                }
                for (std::size_t i = 0; i < 4; ++i) {
                    if (weights[i] != 0 && weights[i] != total) {
                        point.terms.push_back({t.v[i] - base, static_cast<double>(weights[i]) /
                                                                  static_cast<double>(total)});
                    }
                }
                points.emplace(key_of(v), std::move(point));
            }
        }
    }
    DeviationSupport support;
    std::map<Key, std::uint16_t> index;
    for (auto& [key, point] : points) {
        index[key] = static_cast<std::uint16_t>(support.points.size());
        support.points.push_back(std::move(point));
    }
    for (const auto& [key, cube_and_vertices] : cubes) {
        DeviationSupport::Cube c{cube_and_vertices.first, {}};
        for (const Key& v : cube_and_vertices.second) {
            c.points.push_back(index.at(v));
        }
        support.cubes.push_back(std::move(c));
    }
    return support;
}

}  // namespace

const DeviationSupport& deviation_support(int slot, int parity_x, int parity_y, int parity_z,
                                          unsigned flat) {
    constexpr std::size_t kKinds = 8;
    static std::array<std::vector<DeviationSupport>, kKinds> tables;
    static std::array<std::once_flag, kKinds> made;
    std::call_once(made.at(flat), [flat] {
        for (int s = 0; s < kSlots; ++s) {
            for (std::int64_t p = 0; p < 8; ++p) {
                const bool exists =
                    ((static_cast<unsigned>(s + 1) | static_cast<unsigned>(p)) & flat) == 0;
                tables[flat].push_back(exists ? make_support(s, {p & 1, (p >> 1) & 1, p >> 2}, flat)
                                              : DeviationSupport{});
            }
        }
    });
    return tables[flat]
                 [static_cast<std::size_t>(slot * 8 + parity_x + 2 * parity_y + 4 * parity_z)];
}

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
                // Weights are multiples of 1/4 with sum 1: split them into at most four powers of
                // two.
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

/// Raises best_ to the differences at the support's points. If the finer level has deviations of
/// its own, stores the differences in errors_ instead, point by point.
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

/// Raises best_ to the largest difference at each finer cube's vertices plus the cube's deviation.
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
