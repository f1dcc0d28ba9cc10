// The values of a slab of a volume: planes of nodes, dense, x fastest.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Belongs to somebody else.
template <class T>
struct SlabValues {
    const T* data;       ///< of plane `first`
    std::int64_t first;  ///< of the planes that are there
    Int3 nodes;          ///< of the volume

    /// Of the node, whose plane is there.
    [[nodiscard]] const T* at(const Int3& p) const {
        return data + ((p.z - first) * nodes.y + p.y) * nodes.x + p.x;
    }
};

/// The gradient in world units by differences to the neighbours, one-sided at borders: the same
/// numbers as NodeSampler::gradient() at level 0.
template <class T>
class SlabGradient {
  public:
    SlabGradient(const SlabValues<T>& values, const Double3& spacing)
        : values_(values), step_{1, values.nodes.x, values.nodes.x * values.nodes.y} {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            one_[axis] = 1 * spacing[axis];
            two_[axis] = 2 * spacing[axis];
        }
    }

    /// REQUIRES: the planes beside the node's are there, where the volume has them.
    [[nodiscard]] Double3 operator()(const Int3& p) const {
        const T* const at = values_.at(p);
        Double3 g;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const std::int64_t low = p[axis] > 0 ? -step_[a] : 0;
            const std::int64_t high = p[axis] + 1 < values_.nodes[axis] ? step_[a] : 0;
            const double by = static_cast<double>(at[high]) - static_cast<double>(at[low]);
            g[a] = by / (low != 0 && high != 0 ? two_[a] : one_[a]);
        }
        return g;
    }

  private:
    const SlabValues<T>& values_;
    std::array<std::int64_t, 3> step_;
    Double3 one_{};
    Double3 two_{};
};

}  // namespace isonest::detail
