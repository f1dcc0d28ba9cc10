// A brick as seen by the traversal: values and indicators directly from the decoded chunks.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "query/values/topology.h"
#include "store/base/box.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/lattice/children.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The indicators at level 1's faces and edges, computed from the values of a cube of edge 2.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 4 and 5. At the finest scale an indicator does
// not depend on finer ones, so it can be computed from the 27 values of a cube; the store contains
// only the cube's centre (store/FORMAT.md, section 4).

/// Values of the nodes {0, 1, 2}^3 of a cube, numbered x + 3 y + 9 z, with the all-even corner at
/// 0.
using CubeValues = std::array<double, 27>;

/// The values of cube `cube` of level 1 from a box that covers it, mirrored so that the all-even
/// corner is 0.
template <class T>
CubeValues cube_values(const Box<T>& values, const Int3& cube) {
    const unsigned mirror = mirror_of(cube);
    CubeValues u{};
    for (int p = 0; p < 27; ++p) {
        u[static_cast<std::size_t>(p)] =
            static_cast<double>(values.at(cube * 2 + node_offset(p, mirror)));
    }
    return u;
}

namespace finest {

/// The position with every coordinate that is 1 replaced by `by` (0 or 2): the two ends of the
/// refinement edge, in a cube with all-even corner 0.
constexpr int end_of(int position, int by) {
    int out = 0;
    for (int power = 1; power <= 9; power *= 3) {
        const int c = position / power % 3;
        out += power * (c == 1 ? by : c);
    }
    return out;
}

struct Node {
    std::uint8_t low = 0;
    std::uint8_t high = 0;
    std::uint8_t odd = 0;
    std::array<std::uint8_t, 6> children{};  ///< 2 odd of them: faces of a cube, edges of a face
};

constexpr std::array<Node, 27> make_nodes() {
    std::array<Node, 27> nodes{};
    for (int p = 0; p < 27; ++p) {
        Node& node = nodes[static_cast<std::size_t>(p)];
        node.low = static_cast<std::uint8_t>(end_of(p, 0));
        node.high = static_cast<std::uint8_t>(end_of(p, 2));
        const Int3 at = Int3{3, 3, 3}.unlinear(p);
        const auto odd = static_cast<unsigned>((at.x & 1) + 2 * (at.y & 1) + 4 * (at.z & 1));
        node.odd = static_cast<std::uint8_t>(std::popcount(odd));
        for (std::size_t i = 0; i < 2U * node.odd && node.odd > 1; ++i) {
            const Int3& o = child_offsets(odd, 0)[i];
            node.children[i] = static_cast<std::uint8_t>(p + o.x + 3 * o.y + 9 * o.z);
        }
    }
    return nodes;
}
inline constexpr std::array<Node, 27> kNodes = make_nodes();

}  // namespace finest

/// The position of a cube's node of this slot.
constexpr int position_of_slot(int slot) {
    const Int3 o = slot_offset(slot);
    return static_cast<int>(o.x + 3 * o.y + 9 * o.z);
}

/// eta of a node with value `u` between the ends of its refinement edge: +inf if any is missing.
/// `outward`: StoreLayout::rounds_outward().
inline double finest_offset(double u, double end0, double end1, bool outward) {
    const double eta = outward ? outward_offset(u, end0, end1) : std::fabs(u - 0.5 * (end0 + end1));
    return eta <= std::numeric_limits<double>::max() ? eta
                                                     : std::numeric_limits<double>::infinity();
}
inline double finest_offset(const CubeValues& u, int position, bool outward) {
    const auto& node = finest::kNodes[static_cast<std::size_t>(position)];
    return finest_offset(u[static_cast<std::size_t>(position)], u[node.low], u[node.high], outward);
}

/// linf_bar (which is deviation_bar at level 1), or linf_plus, at an edge midpoint, a face centre
/// or the cube's centre. REQUIRES: position is odd in at least one coordinate.
inline double finest_indicator(const CubeValues& u, int position, bool plus, bool outward) {
    const auto& node = finest::kNodes[static_cast<std::size_t>(position)];
    const double eta = finest_offset(u, position, outward);
    if (node.odd == 1) {
        return eta;
    }
    double largest = 0;
    for (std::size_t i = 0; i < 2U * node.odd; ++i) {
        largest = std::max(largest, finest_indicator(u, node.children[i], plus, outward));
    }
    return plus ? eta + largest : std::max(eta, largest);
}

/// The nodes of one chunk, starting at `base`, and the first ones of the next chunks along each
/// axis: up to 2 x 2 x 2 chunks, each decoded at first use. Not thread-safe, not even const
/// members.
class ChunkGroup {
  public:
    ChunkGroup() = default;
    /// REQUIRES: base is a multiple of the array's chunk.
    ChunkGroup(ChunkCache& cache, const ArrayInfo& array, const Int3& base)
        : cache_(&cache), array_(&array), first_(array.chunk_of(base)) {}

    /// The element at node base + p. REQUIRES: 0 <= p <= chunk, inside the lattice.
    template <class T>
    [[nodiscard]] T at(const Int3& p, int component = 0) const {
        const Int3& c = array_->chunk;
        if (p.x < c.x && p.y < c.y && p.z < c.z) {
            if (first_chunk_ == nullptr) {
                first_chunk_ = cache_->get(*array_, first_);
            }
            return reinterpret_cast<const T*>(
                first_chunk_.get())[c.linear(p) * array_->components + component];
        }
        const Int3 which{p.x >= c.x ? 1 : 0, p.y >= c.y ? 1 : 0, p.z >= c.z ? 1 : 0};
        const auto slot = static_cast<unsigned>(which.x + 2 * which.y + 4 * which.z);
        ChunkNodes& nodes = next_[slot - 1];
        if (nodes.data == nullptr) {
            nodes = cache_->nodes(*array_, first_ + which, slot);
        }
        const std::int64_t element = (p.x - which.x * c.x) * nodes.stride.x +
                                     (p.y - which.y * c.y) * nodes.stride.y +
                                     (p.z - which.z * c.z) * nodes.stride.z;
        return reinterpret_cast<const T*>(
            nodes.data.get())[element * array_->components + component];
    }

    /// The element at node base + p if the chunk at the base, decoded, contains nodes p to p +
    /// size; otherwise null. Neighbours are at offsets by Int3::linear of the array's chunk.
    template <class T>
    [[nodiscard]] const T* within_first(const Int3& p, std::int64_t size) const {
        const Int3& c = array_->chunk;
        const bool inside = p.x + size < c.x && p.y + size < c.y && p.z + size < c.z;
        return inside && first_chunk_ != nullptr
                   ? reinterpret_cast<const T*>(first_chunk_.get()) + c.linear(p)
                   : nullptr;
    }

  private:
    ChunkCache* cache_ = nullptr;
    const ArrayInfo* array_ = nullptr;
    Int3 first_;
    mutable DecodedChunk first_chunk_;
    mutable std::array<ChunkNodes, 7> next_;
};

/// An indicator field around one brick.
class IndicatorView {
  public:
    IndicatorView() = default;
    IndicatorView(ChunkCache& cache, const ArrayInfo& array, const Int3& base)
        : chunks_(cache, array, base),
          first_slot_(array.first_slot),
          exact_(array.codec.element_size == sizeof(float)) {}
    /// REQUIRES: the array stores the slot: slot >= ArrayInfo::first_slot.
    [[nodiscard]] double at(const Int3& node, int slot) const {
        const int component = slot - first_slot_;
        return exact_ ? static_cast<double>(chunks_.at<float>(node, component))
                      : static_cast<double>(
                            decode_indicator(chunks_.at<IndicatorCode>(node, component)));
    }

  private:
    ChunkGroup chunks_;
    int first_slot_ = 0;
    bool exact_ = false;
};

// One indicator field as seen by a brick: stored or, at the finest level, computed from the values.

/// The eighth of a brick that contains a cube, in coordinates relative to the brick.
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
        // Stored above the finest level; at that level it follows from the values, except for some
        // fields.
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
    /// At node `position` (a face or edge of level L + 1) of the cube with these values.
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
