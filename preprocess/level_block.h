// All indicators of one level on one block: values in, saturated layers out.
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "preprocess/deviation.h"
#include "preprocess/linf.h"
#include "preprocess/missing.h"
#include "preprocess/row_kernels.h"
#include "preprocess/saturation.h"
#include "store/field.h"
#include "store/value_type.h"

namespace isonest {

/// Values of a lattice around a block, and which of them are missing (not finite).
template <class T>
struct ValueBox {
    Box<T> values;
    MissingBox missing;  ///< same shape; only filled if has_missing
    bool has_missing = false;

    /// Looks for non-finite values. Call once the values are in.
    void find_missing() {
        if constexpr (std::is_floating_point_v<T>) {
            for (const T v : values.data) {
                has_missing = has_missing || !std::isfinite(v);
            }
            if (has_missing) {
                missing = MissingBox(values.lo, values.size);
                for (std::size_t i = 0; i < values.data.size(); ++i) {
                    missing.data[i] = std::isfinite(values.data[i]) ? 0 : 1;
                }
            }
        }
    }
    template <class Real>
    [[nodiscard]] Real number(T v) const {
        if constexpr (std::is_floating_point_v<T>) {
            return has_missing && !std::isfinite(v) ? Real{0} : static_cast<Real>(v);
        } else {
            return static_cast<Real>(v);
        }
    }
};

/// What run_level() needs. Boxes are borrowed.
template <class T>
struct LevelTask {
    LayerRange range;  ///< REQUIRES: range.lo.x even where the deviation is wanted
    /// Values of level max(L - 2, 0), from 4 lo - 2 to 4 hi + 2 (level 1: from 2 lo - 1 to 2 hi +
    /// 1).
    const ValueBox<T>* values = nullptr;
    int step = 2;     ///< nodes of `values` per half cube edge: 1 at level 1, else 2
    Int3 fine_cells;  ///< cubes of level L - 2
    /// Saturated centres of level L - 1, cubes 2 lo - 1 to 2 hi, 0 outside; null at level 1.
    const Box<float>* bar_centres = nullptr;
    const Box<float>* plus_centres = nullptr;
    const Box<float>* deviation_centres = nullptr;
    /// Deviations of the cubes of level L - 2, cubes 4 lo - 2 to 4 hi + 2, NaN outside; null for L
    /// <= 2.
    const Box<float>* fine_deviation = nullptr;
    bool want_bar = false;
    bool want_plus = false;
    bool want_deviation = false;
};

namespace level_block {

template <class T, class Real>
void fill_plane(const LevelTask<T>& task, std::int64_t z, SplitPlane<Real>& plane) {
    const ValueBox<T>& box = *task.values;
    const std::int64_t nx = task.range.count(0);
    std::vector<Real> line(static_cast<std::size_t>(2 * nx));
    for (std::int64_t y = 0; y < plane.rows(); ++y) {
        const T* const row = box.values.row(task.step * (2 * task.range.lo.y + y), task.step * z) +
                             (2 * task.step * task.range.lo.x - box.values.lo.x);
        for (std::int64_t i = 0; i < 2 * nx; ++i) {
            line[static_cast<std::size_t>(i)] = box.template number<Real>(row[task.step * i]);
        }
        split_row(line.data(), plane.even(y), plane.odd(y), nx);
    }
}

/// The missing nodes on the lattice of stride 2^(L-1), from 2 lo - 1 to 2 hi + 1.
template <class T>
MissingBox missing_at_half_edge(const LevelTask<T>& task) {
    const Int3 lo = task.range.lo * 2 - Int3{1, 1, 1};
    const Int3 hi = task.range.hi * 2 + Int3{1, 1, 1};
    MissingBox out(lo, hi - lo + Int3{1, 1, 1});
    const MissingBox& from = task.values->missing;
    const Int3 last = from.lo + from.size - Int3{1, 1, 1};
    for (std::int64_t i = 0; i < out.size.product(); ++i) {
        const Int3 p = (lo + out.size.unlinear(i)) * task.step;
        out.data[static_cast<std::size_t>(i)] = from.at(max(from.lo, min(p, last)));
    }
    return out;
}

/// The deviation of a node is +inf if its support holds a missing value.
template <class T, class Real>
void mark_missing_support(const LevelTask<T>& task, std::int64_t k, int first_slot, int last_slot,
                          Layer<Real>& layer) {
    const LayerRange& range = task.range;
    const MissingBox& missing = task.values->missing;
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 owner{range.lo.x + i, range.lo.y + j, k};
        const auto& support =
            deviation_support(slot, static_cast<int>(owner.x & 1), static_cast<int>(owner.y & 1),
                              static_cast<int>(k & 1));
        for (const auto& point : support.points) {
            const Int3 p = owner * 4 + point.at;
            if (min(p, {0, 0, 0}) == Int3{0, 0, 0} && max(p, task.fine_cells) == task.fine_cells &&
                missing.at(p) != 0) {
                layer.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
            }
        }
    });
}

template <class Real>
void copy_slots(const Layer<Real>& from, int first, int last, std::int64_t rows, std::int64_t n,
                Layer<Real>& to) {
    for (int slot = first; slot <= last; ++slot) {
        for (std::int64_t j = 0; j < rows; ++j) {
            std::copy_n(from.row(slot, j), n, to.row(slot, j));
        }
    }
}

}  // namespace level_block

/// Computes the wanted fields and calls emit(Field, k, layer) for every complete layer k of
/// lattice nodes, in ascending order. No I/O. Thread-safe for separate tasks.
template <class T, class Emit>
void run_level(const LevelTask<T>& task, Emit&& emit) {
    using Real = RealFor<T>;
    using namespace level_block;
    const LayerRange& range = task.range;
    const bool linf = task.want_bar || task.want_plus;
    const std::int64_t nx = range.count(0);
    const std::int64_t ny = range.count(1);
    std::array<SplitPlane<Real>, 3> planes;
    std::array<Layer<Real>, 2> bar;
    std::array<Layer<Real>, 2> plus;
    std::array<Layer<Real>, 2> deviation;
    std::optional<DeviationKernel<Real>> kernel;
    std::optional<MissingBox> missing;
    if (linf) {
        planes.fill(SplitPlane<Real>(range));
        bar.fill(Layer<Real>(nx, ny));
        plus.fill(Layer<Real>(nx, ny));
        if (task.values->has_missing) {
            missing = missing_at_half_edge(task);
        }
    }
    if (task.want_deviation) {
        kernel.emplace(range, task.fine_cells, task.fine_deviation != nullptr);
        deviation.fill(Layer<Real>(nx, ny));
    }
    std::int64_t next_plane = 4 * range.lo.z - 2;
    const auto load_until = [&](std::int64_t z_end) {
        for (; next_plane < z_end; ++next_plane) {
            const std::int64_t z = next_plane;
            kernel->load_plane(
                z,
                [&](std::int64_t y, Real* out) {
                    const T* const row = task.values->values.row(y, z) +
                                         (kernel->low_x() - task.values->values.lo.x);
                    for (std::int64_t i = 0; i <= kernel->high_x() - kernel->low_x(); ++i) {
                        out[i] = task.values->template number<Real>(row[i]);
                    }
                },
                [&](std::int64_t y, Real* out) {
                    const float* const row = task.fine_deviation->row(y, z) +
                                             (kernel->low_x() - task.fine_deviation->lo.x);
                    std::copy_n(row, kernel->high_x() - kernel->low_x() + 1, out);
                });
        }
    };

    const auto mark = [&](std::int64_t k, int first_slot, int last_slot, Layer<Real>& eta) {
        if (missing && task.step == 1) {
            mark_missing_finest(range, k, first_slot, last_slot, *missing, eta);
        } else if (missing) {
            mark_missing(range, k, first_slot, last_slot, *missing, eta);
        }
    };

    for (std::int64_t k = range.lo.z; k <= range.hi.z; ++k) {
        const auto now = static_cast<std::size_t>(k & 1);
        const std::size_t before = 1 - now;
        const bool has_odd = k - range.lo.z < range.odd_count(2);
        if (linf) {
            bar[now].clear();
            if (k == range.lo.z) {
                fill_plane(task, 2 * k, planes[0]);
            } else {
                std::swap(planes[0], planes[2]);
            }
            linf_even_plane(range, planes[0], bar[now]);
            mark(k, 0, 2, bar[now]);
            if (has_odd) {
                fill_plane(task, 2 * k + 1, planes[1]);
                fill_plane(task, 2 * k + 2, planes[2]);
                linf_odd_plane(range, k, planes[0], planes[1], planes[2], bar[now]);
                mark(k, 3, 6, bar[now]);
            }
            if (task.want_plus) {
                copy_slots(bar[now], 0, kSlots - 1, ny, nx, plus[now]);
                saturate_even_plane<SaturatePlus>(range, k, task.plus_centres, plus[now]);
            }
            if (task.want_bar) {
                saturate_even_plane<SaturateBar>(range, k, task.bar_centres, bar[now]);
            }
        }
        if (task.want_deviation) {
            load_until(has_odd ? 4 * k + 5 : 4 * k + 3);
            deviation[now].clear();
            kernel->layer(k, 0, 2, deviation[now]);
            if (has_odd) {
                kernel->layer(k, 3, 6, deviation[now]);
            }
            if (task.values->has_missing) {
                mark_missing_support(task, k, 0, has_odd ? 6 : 2, deviation[now]);
            }
            saturate_even_plane<SaturateBar>(range, k, task.deviation_centres, deviation[now]);
        }
        const auto emit_layer = [&](std::int64_t layer, std::size_t which) {
            if (task.want_bar) {
                emit(Field::linf_bar, layer, std::as_const(bar[which]));
            }
            if (task.want_plus) {
                emit(Field::linf_plus, layer, std::as_const(plus[which]));
            }
            if (task.want_deviation) {
                emit(Field::deviation_bar, layer, std::as_const(deviation[which]));
            }
        };
        if (k > range.lo.z) {
            if (task.want_bar) {
                saturate_odd_plane<SaturateBar>(range, k - 1, task.bar_centres, bar[now],
                                                bar[before]);
            }
            if (task.want_plus) {
                saturate_odd_plane<SaturatePlus>(range, k - 1, task.plus_centres, plus[now],
                                                 plus[before]);
            }
            if (task.want_deviation) {
                saturate_odd_plane<SaturateBar>(range, k - 1, task.deviation_centres,
                                                deviation[now], deviation[before]);
            }
            emit_layer(k - 1, before);
        }
        if (k == range.hi.z && !has_odd && range.hi.z == range.cells.z) {
            emit_layer(k, now);
        }
    }
}

}  // namespace isonest
