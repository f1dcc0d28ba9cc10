// Where it is known before a brick is worked on that the traversal stops above its subcubes.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>

#include "query/traverse/traversal_run.h"
#include "query/view/field_view.h"
#include "query/view/topology.h"
#include "store/container/indicator_code.h"

namespace isonest::detail {

/// Bits of the last refinement nodes on the way down to the subcubes where the tetrahedra in `mask`
/// are refined.
inline std::uint32_t edge_nodes(std::uint8_t mask) {
    const Topology& tables = topology();
    std::uint32_t nodes = 0;
    for (unsigned order = 0; order < 6; ++order) {
        for (const std::uint8_t face : tables.cube[order].children) {
            for (const std::uint8_t edge : tables.face[face].children) {
                nodes |= (mask >> order & 1U) != 0 ? 1U << tables.edge[edge].ref_node : 0U;
            }
        }
    }
    return nodes;
}

/// What is known of the stop test in a brick before anything more of it is there: the indicators of
/// the level above were decoded where they are its parents' centres.
class KnownStops {
  public:
    KnownStops(const TraversalRun& run, int level, const Int3& brick)
        : tolerance_(run.query.tolerance), stride_(std::int64_t{1} << level) {
        const StoreLayout& layout = run.layout();
        if (tolerance_.is_zero() || level == 0 || level == layout.lattice().top()) {
            return;
        }
        array_ = &layout.array(level + 1, run.query.stop);
        for (std::size_t slot = 0; slot < 8; ++slot) {
            const Int3 chunk = brick + kOctants.unlinear(static_cast<std::int64_t>(slot));
            if (array_->has_chunk(chunk)) {
                chunks_[slot] = run.cache.peek(*array_, chunk);
            }
        }
    }

    /// Whether tetrahedra in `mask` of a cube may be refined to its subcubes. `local`: the cube,
    /// counted from the brick's first.
    [[nodiscard]] bool may_reach_subcubes(const Int3& cube, const Int3& local,
                                          std::uint8_t mask) const {
        if (array_ == nullptr) {
            return true;
        }
        const unsigned mirror = mirror_of(cube);
        for (std::uint32_t nodes = edge_nodes(mask); nodes != 0; nodes &= nodes - 1) {
            const Int3& offset = node_offset(std::countr_zero(nodes), mirror);
            const std::optional<double> eta = at(local * 2 + offset);
            if (!eta || !tolerance_.stops(*eta, (cube * 2 + offset) * (2 * stride_), 2 * stride_)) {
                return true;
            }
        }
        return false;
    }

  private:
    /// At a node of the brick's level, counted from its first.
    [[nodiscard]] std::optional<double> at(const Int3& p) const {
        const Int3& size = array_->chunk;
        Int3 owner{p.x >> 1, p.y >> 1, p.z >> 1};
        std::size_t slot = 0;
        for (int axis = 0; axis < 3; ++axis) {
            if (owner[axis] >= size[axis]) {
                owner[axis] -= size[axis];
                slot |= std::size_t{1} << static_cast<unsigned>(axis);
            }
        }
        const int component = slot_of(p) - array_->first_slot;
        if (chunks_[slot] == nullptr || component < 0) {
            return std::nullopt;
        }
        const std::int64_t element = size.linear(owner) * array_->components + component;
        return array_->codec.element_size == sizeof(float)
                   ? static_cast<double>(
                         reinterpret_cast<const float*>(chunks_[slot].get())[element])
                   : static_cast<double>(decode_indicator(
                         reinterpret_cast<const IndicatorCode*>(chunks_[slot].get())[element]));
    }

    const Tolerance& tolerance_;
    std::int64_t stride_;
    const ArrayInfo* array_ = nullptr;  ///< null: nothing is known
    std::array<DecodedChunk, 8> chunks_;
};

}  // namespace isonest::detail
