// What a brick sees of one indicator field: stored or, at the finest level, from the values.
#pragma once

#include <array>

#include "query/view/brick_view.h"
#include "query/view/finest_indicators.h"

namespace isonest::detail {

/// Which eighth of a brick a cube lies in, counted from the brick's first.
inline Int3 octant_of(const Int3& local, std::int64_t half) {
    return {local.x >= half ? 1 : 0, local.y >= half ? 1 : 0, local.z >= half ? 1 : 0};
}
constexpr Int3 kOctants{2, 2, 2};

/// One field around a brick of level L: at the faces and edges of level L + 1, and at the centres
/// of level L.
class FieldView {
  public:
    FieldView() = default;
    FieldView(ChunkCache& cache, Field field, int level, const Int3& brick, std::int64_t half) {
        const StoreLayout& layout = cache.source().layout();
        // Above the finest level; there the values say it, but for fields that are stored.
        derived_ = level == 0 && centre_suffices_at_level_1(field);
        outward_ = layout.rounds_outward();
        plus_ = saturation_of(field) == Saturation::plus;
        base_ = brick * (2 * half);
        half_ = half;
        if (!derived_ && level < layout.lattice().top()) {
            parents_ = IndicatorView(cache, layout.array(level + 1, field), brick * half);
        }
        for (int octant = 0; octant < 8 && level > 0; ++octant) {
            const Int3 o = kOctants.unlinear(octant);
            centres_[static_cast<std::size_t>(octant)] =
                IndicatorView(cache, layout.array(level, field), base_ + o * half);
        }
    }
    /// At node `position` of the cube with these values, a face or edge of level L + 1.
    [[nodiscard]] double at(const CubeValues& values, const Int3& low, unsigned mirror,
                            int position) const {
        if (derived_) {
            return finest_indicator(values, position, plus_, outward_);
        }
        const Int3 p = (low - base_) + node_offset(position, mirror);
        return parents_.at({p.x >> 1, p.y >> 1, p.z >> 1}, slot_of(p));
    }
    /// At the centre of a cube of level L > 0 in this brick.
    [[nodiscard]] double centre(const Int3& cube) const {
        const Int3 local = cube - base_;
        const Int3 o = octant_of(local, half_);
        return centres_[static_cast<std::size_t>(kOctants.linear(o))].at(local - o * half_,
                                                                         kCentreSlot);
    }

  private:
    bool derived_ = false;
    bool plus_ = false;
    bool outward_ = false;
    Int3 base_;
    std::int64_t half_ = 0;
    IndicatorView parents_;
    std::array<IndicatorView, 8> centres_;
};

}  // namespace isonest::detail
