// Computes all indicators of one level on one block: values in, saturated layers out.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/deviation.h"
#include "preprocess/indicators/hex_offset.h"
#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/normal_indicators.h"
#include "preprocess/indicators/offset_norms.h"
#include "preprocess/indicators/own_indicators.h"
#include "preprocess/indicators/row_kernels.h"
#include "preprocess/indicators/value_rows.h"
#include "store/base/vectors.h"
#include "store/container/codec.h"

namespace isonest::detail {

/// Values of a lattice around a block, and which of them are missing (not finite).
template <class T>
struct ValueBox {
    Box<T> values;
    MissingBox missing;  ///< same shape; only filled if has_missing
    bool has_missing = false;

    /// Looks for non-finite values. To be called once the values are complete.
    void find_missing() {
        if constexpr (std::is_floating_point_v<T>) {
            has_missing =
                !all_finite(values.data.data(), static_cast<std::int64_t>(values.data.size()));
            if (has_missing) {
                missing = MissingBox(values.lo, values.size);
                for (std::size_t i = 0; i < values.data.size(); ++i) {
                    missing.data[i] = std::isfinite(values.data[i]) ? 0 : 1;
                }
            }
        }
    }
};

/// One saturated field that a block produces.
struct FieldTask {
    Field field = Field::linf_bar;
    /// Its saturated centres of level L - 1, cubes 2 lo - 1 to 2 hi, 0 outside; null at level 1.
    const Box<float>* centres = nullptr;
};

/// Input of run_level(). Boxes are borrowed.
template <class T>
struct LevelTask {
    LayerRange range;  ///< REQUIRES: range.lo.x is even if the deviation is wanted
    /// Values of level max(L - 2, 0), from 4 lo - 2 to 4 hi + 2 (level 1: from 2 lo - 1 to 2 hi +
    /// 1).
    const ValueBox<T>* values = nullptr;
    int step = 2;  ///< nodes of `values` per half cube edge: 1 at level 1, else 2
    int level = 1;
    LatticeSteps steps = {};
    unsigned flat = 0;  ///< bits of the flat axes
    Int3 fine_cells;    ///< cubes of level L - 2
    /// Deviations of the cubes of level L - 2, cubes 4 lo - 2 to 4 hi + 2, NaN outside; null for L
    /// <= 2.
    const Box<float>* fine_deviation = nullptr;
    /// The caller's indicators; null if there are none.
    const OwnIndicators* own = nullptr;
    /// At level 1 without deviation, see source_at_level_1().
    std::vector<FieldTask> fields;

    [[nodiscard]] bool wants(Indicator indicator) const {
        return std::any_of(fields.begin(), fields.end(),
                           [&](const FieldTask& f) { return indicator_of(f.field) == indicator; });
    }
};

namespace level_block {

template <class T, class Real>
void fill_plane(const LevelTask<T>& task, std::int64_t z, SplitPlane<Real>& plane) {
    const ValueBox<T>& box = *task.values;
    const std::int64_t nx = task.range.count(0);
    for (std::int64_t y = 0; y < plane.rows(); ++y) {
        const T* const row = box.values.row(task.step * (2 * task.range.lo.y + y), task.step * z) +
                             (2 * task.step * task.range.lo.x - box.values.lo.x);
        split_row(row, task.step, plane.even(y), plane.odd(y), nx);
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

/// Sets the deviation of a node to +inf if its support contains a missing value.
template <class T, class Real>
void mark_missing_support(const LevelTask<T>& task, std::int64_t k, int first_slot, int last_slot,
                          Layer<Real>& layer) {
    const LayerRange& range = task.range;
    const MissingBox& missing = task.values->missing;
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 owner{range.lo.x + i, range.lo.y + j, k};
        const auto& support =
            deviation_support(slot, static_cast<int>(owner.x & 1), static_cast<int>(owner.y & 1),
                              static_cast<int>(k & 1), task.flat);
        for (const auto& point : support.points) {
            const Int3 p = owner * 4 + point.at;
            if (min(p, {0, 0, 0}) == Int3{0, 0, 0} && max(p, task.fine_cells) == task.fine_cells &&
                missing.at(p) != 0) {
                layer.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
            }
        }
    });
}

/// The smallest number of the type that is not below `number`. REQUIRES: number >= 0.
template <class Real>
Real round_up(double number) {
    if constexpr (std::is_same_v<Real, float>) {
        return round_up_to_float(number);
    } else {
        return number;
    }
}

/// Unsaturated measures of the nodes of one layer, by indicator.
template <class T>
class Measures {
  public:
    using Real = RealFor<T>;
    static constexpr bool kOutward = rounds_outward<T>;
    explicit Measures(const LevelTask<T>& task) : task_(task) {
        const std::int64_t nx = task.range.count(0);
        const std::int64_t ny = task.range.count(1);
        for (const FieldTask& f : task.fields) {
            const Indicator indicator = indicator_of(f.field);
            const bool offset = OffsetNorms::is_offset_norm(indicator);
            offset_wanted_ = offset_wanted_ || offset;
            if (offset && indicator != Indicator::linf && !norms_) {
                norms_.emplace(task.steps, task.level, task.flat);
            }
            cell_wanted_ = cell_wanted_ || is_of_cells(f.field);
            normal_wanted_ = normal_wanted_ || (indicator >= Indicator::normal_jump &&
                                                indicator <= Indicator::normal);
        }
        if (task.own != nullptr) {
            batch_.emplace(nx, ny, task.own->volume());
            own_.assign(task.own->size(), Layer<Real>(nx, ny));
        }
        if (offset_wanted_) {
            planes_.fill(SplitPlane<Real>(task.range));
            eta_ = Layer<Real>(nx, ny);
        }
        if (cell_wanted_) {
            cell_ = Layer<Real>(nx, ny);
        }
        if (task.values->has_missing && (offset_wanted_ || normal_wanted_)) {
            missing_ = missing_at_half_edge(task);
        }
        if (task.wants(Indicator::deviation)) {
            kernel_.emplace(task.range, task.fine_cells, task.fine_deviation != nullptr, task.flat,
                            kOutward);
            deviation_ = Layer<Real>(nx, ny);
        }
        if (normal_wanted_) {
            normals_.emplace(task.steps, task.level, task.flat);
            for (Layer<Real>& layer : changes_) {
                layer = Layer<Real>(nx, ny);
            }
        }
    }

    /// REQUIRES: called for k = range.lo.z .. range.hi.z, in order.
    void compute(std::int64_t k) {
        const bool has_odd = k - task_.range.lo.z < task_.range.odd_count(2);
        const int last = has_odd ? kSlots - 1 : 2;
        if (offset_wanted_) {
            offsets(k, has_odd);
        }
        if (kernel_) {
            load_until(has_odd ? 4 * k + 5 : 4 * k + 3);
            deviation_.clear();
            kernel_->layer(k, 0, last, deviation_);
            if (task_.values->has_missing) {
                mark_missing_support(task_, k, 0, last, deviation_);
            }
        }
        if (normals_) {
            normal_changes(k, last);
        }
        if (batch_) {
            own_indicators(k, last);
        }
        if (cell_wanted_) {
            cell_.clear();
            if (has_odd || (task_.flat & 4U) != 0) {
                hex_offsets(task_.range, k, task_.flat, task_.step, task_.values->values, cell_);
            }
        }
    }

    /// Copies the measure of a field, or moves it if no other field needs it.
    void hand_out(std::size_t which, std::int64_t k, Layer<Real>& to) {
        const Indicator indicator = indicator_of(task_.fields[which].field);
        Layer<Real>& from = layer_of(task_.fields[which].field);
        const bool needed = std::any_of(
            task_.fields.begin() + static_cast<std::ptrdiff_t>(which) + 1, task_.fields.end(),
            [&](const FieldTask& f) { return &layer_of(f.field) == &from; });
        if (needed) {
            to = from;
        } else {
            std::swap(to, from);
        }
        if (indicator != Indicator::linf && OffsetNorms::is_offset_norm(indicator)) {
            const bool has_odd = k - task_.range.lo.z < task_.range.odd_count(2);
            norms_->scale(indicator, task_.range, k, 0, has_odd ? kSlots - 1 : 2, to);
        }
    }

  private:
    Layer<Real>& layer_of(Field field) {
        switch (indicator_of(field)) {
            case Indicator::of_user:
                return own_[task_.own->index_of(field)];
            case Indicator::deviation:
                return deviation_;
            case Indicator::hex_offset:
                return cell_;
            case Indicator::normal_jump:
                return changes_[0];
            case Indicator::normal_edge:
                return changes_[1];
            case Indicator::normal_turn:
                return changes_[2];
            case Indicator::normal:
                return changes_[3];
            default:
                return eta_;
        }
    }

    void mark(std::int64_t k, int first, int last, Layer<Real>& layer) {
        if (missing_ && task_.step == 1) {
            mark_missing_finest(task_.range, k, first, last, *missing_, layer);
        } else if (missing_) {
            mark_missing(task_.range, k, first, last, *missing_, layer);
        }
    }

    void offsets(std::int64_t k, bool has_odd) {
        eta_.clear();
        if (k == task_.range.lo.z) {
            fill_plane(task_, 2 * k, planes_[0]);
        } else {
            std::swap(planes_[0], planes_[2]);
        }
        linf_even_plane(task_.range, planes_[0], eta_, kOutward);
        mark(k, 0, 2, eta_);
        if (has_odd) {
            fill_plane(task_, 2 * k + 1, planes_[1]);
            fill_plane(task_, 2 * k + 2, planes_[2]);
            linf_odd_plane(task_.range, k, planes_[0], planes_[1], planes_[2], eta_, kOutward);
            mark(k, 3, kSlots - 1, eta_);
        }
    }

    void load_until(std::int64_t z_end) {
        for (; next_plane_ < z_end; ++next_plane_) {
            const std::int64_t z = next_plane_;
            const std::int64_t n = kernel_->high_x() - kernel_->low_x() + 1;
            kernel_->load_plane(
                z,
                [&](std::int64_t y, Real* out) {
                    const T* const row = task_.values->values.row(y, z) +
                                         (kernel_->low_x() - task_.values->values.lo.x);
                    widen_row(row, out, n);
                },
                [&](std::int64_t y, Real* out) {
                    const float* const row = task_.fine_deviation->row(y, z) +
                                             (kernel_->low_x() - task_.fine_deviation->lo.x);
                    std::copy_n(row, n, out);
                });
        }
    }

    void normal_changes(std::int64_t k, int last) {
        for (Layer<Real>& layer : changes_) {
            layer.clear();
        }
        const Box<T>& box = task_.values->values;
        const Int3 elements = max(task_.range.cells, {1, 1, 1});
        each_node(task_.range, 0, last, [&](int slot, std::int64_t i, std::int64_t j) {
            if ((static_cast<unsigned>(slot + 1) & task_.flat) != 0) {
                return;
            }
            const Int3 owner{task_.range.lo.x + i, task_.range.lo.y + j, k};
            const Int3 node = owner * 2 + slot_offset(slot);
            Neighbourhood u{};
            for (std::int64_t n = 0; n < 27; ++n) {
                const Int3 at = node + (Int3{3, 3, 3}).unlinear(n) - Int3{1, 1, 1};
                u[static_cast<std::size_t>(n)] = static_cast<double>(box.at(at * task_.step));
            }
            const NormalChange c = normals_->at(owner, slot, elements, u);
            // Rounded up far enough that the sums of a saturation are not below the exact ones.
            constexpr double kUp =
                1 + 4 * static_cast<double>(std::numeric_limits<Real>::epsilon());
            changes_[0].row(slot, j)[i] = static_cast<Real>(c.jump * kUp);
            changes_[1].row(slot, j)[i] = static_cast<Real>(c.edge * kUp);
            changes_[2].row(slot, j)[i] = static_cast<Real>(c.turn * kUp);
            changes_[3].row(slot, j)[i] = static_cast<Real>(c.component * kUp);
        });
        for (Layer<Real>& layer : changes_) {
            mark(k, 0, last, layer);
        }
    }

    void own_indicators(std::int64_t k, int last) {
        for (Layer<Real>& layer : own_) {
            layer.clear();
        }
        const Box<T>& box = task_.values->values;
        const Int3 elements = max(task_.range.cells, {1, 1, 1});
        for (int slot = 0; slot <= last; ++slot) {
            if ((static_cast<unsigned>(slot + 1) & task_.flat) != 0) {
                continue;
            }
            const Int3 o = slot_offset(slot);
            const std::int64_t nx = task_.range.count(0, static_cast<int>(o.x));
            for (std::int64_t j = 0; j < task_.range.count(1, static_cast<int>(o.y)); ++j) {
                if (!batch_->has_room(nx)) {
                    finish_batch(slot);
                }
                for (std::int64_t i = 0; i < nx; ++i) {
                    const Int3 owner{task_.range.lo.x + i, task_.range.lo.y + j, k};
                    const bool complete = batch_->add(
                        owner, slot, task_.level, task_.flat, elements, i, j,
                        [&](const Int3& p) { return static_cast<double>(box.at(p * task_.step)); });
                    for (std::size_t w = 0; w < own_.size() && !complete; ++w) {
                        own_[w].row(slot, j)[i] = std::numeric_limits<Real>::infinity();
                    }
                }
            }
            finish_batch(slot);
        }
    }

    void finish_batch(int slot) {
        for (std::size_t w = 0; w < own_.size(); ++w) {
            batch_->evaluate(*task_.own, w, [&](std::int64_t i, std::int64_t j, double eta) {
                own_[w].row(slot, j)[i] = round_up<Real>(eta);
            });
        }
        batch_->clear();
    }

    const LevelTask<T>& task_;
    std::optional<OffsetNorms> norms_;  ///< if a field is a multiple of |U_delta|
    bool offset_wanted_ = false;
    bool normal_wanted_ = false;
    bool cell_wanted_ = false;
    Layer<Real> cell_;
    std::array<SplitPlane<Real>, 3> planes_;
    Layer<Real> eta_;
    Layer<Real> deviation_;
    std::array<Layer<Real>, 4> changes_;
    std::vector<Layer<Real>> own_;
    std::optional<DiamondBatch> batch_;  ///< if there are own indicators
    std::optional<MissingBox> missing_;
    std::optional<DeviationKernel<Real>> kernel_;
    std::optional<NormalIndicators> normals_;
    std::int64_t next_plane_ = 4 * task_.range.lo.z - 2;
};

}  // namespace level_block

/// Computes the wanted fields and calls emit(Field, k, layer) for every complete layer k of
/// lattice nodes, in ascending order. No I/O. Thread-safe for separate tasks.
template <class T, class Emit>
void run_level(const LevelTask<T>& task, Emit&& emit) {
    using Real = RealFor<T>;
    const LayerRange& range = task.range;
    level_block::Measures<T> measures(task);
    // Layers k - 1 and k of each field: an odd plane is complete only when the even plane above it
    // is.
    std::vector<std::array<Layer<Real>, 2>> layers(task.fields.size());
    for (auto& pair : layers) {
        pair.fill(Layer<Real>(range.count(0), range.count(1)));
    }
    for (std::int64_t k = range.lo.z; k <= range.hi.z; ++k) {
        const auto now = static_cast<std::size_t>(k & 1);
        const bool has_odd = k - range.lo.z < range.odd_count(2);
        measures.compute(k);
        for (std::size_t f = 0; f < layers.size(); ++f) {
            const auto [field, centres] = task.fields[f];
            Layer<Real>& layer = layers[f][now];
            Layer<Real>& below = layers[f][1 - now];
            measures.hand_out(f, k, layer);
            if (is_of_cells(field)) {
                saturate_cells(range, k, task.flat, centres, saturation_of(field), layer);
            } else if (saturation_of(field) == Saturation::bar) {
                saturate_even_plane<SaturateBar>(range, k, centres, layer);
            } else {
                saturate_even_plane<SaturatePlus>(range, k, centres, layer);
            }
            if (k == range.lo.z) {
                continue;
            }
            if (is_of_cells(field)) {
                // Complete by itself.
            } else if (saturation_of(field) == Saturation::bar) {
                saturate_odd_plane<SaturateBar>(range, k - 1, centres, layer, below);
            } else {
                saturate_odd_plane<SaturatePlus>(range, k - 1, centres, layer, below);
            }
            emit(field, k - 1, std::as_const(below));
        }
        if (k == range.hi.z && !has_odd && range.hi.z == range.cells.z) {
            for (std::size_t f = 0; f < layers.size(); ++f) {
                emit(task.fields[f].field, k, std::as_const(layers[f][now]));
            }
        }
    }
}

}  // namespace isonest::detail
