// Indicators of the caller: makes the diamonds of the nodes of a row, calls the function, and
// checks what it returns.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/own_indicator.h>
#include <isonest/volume_source.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/offset_norms.h"

namespace isonest::detail {

/// Maximum number of elements around a node.
inline constexpr std::size_t kMaxDiamond = 8;

/// The own indicators of a run. Thread-safe.
class OwnIndicators {
  public:
    OwnIndicators() = default;
    /// Throws Error{invalid_argument, unsupported} for invalid or repeated names, too many
    /// indicators, a missing function, or a volume of labels.
    OwnIndicators(std::span<const OwnIndicator> indicators, VolumeDescription volume);

    [[nodiscard]] std::size_t size() const { return indicators_.size(); }
    [[nodiscard]] const VolumeDescription& volume() const { return volume_; }
    /// The fields of all indicators.
    [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }
    /// The indicator of an own field. REQUIRES: there is one.
    [[nodiscard]] std::size_t index_of(Field field) const;
    /// Throws Error{invalid_argument} if a number is negative or NaN, naming the node.
    void evaluate(std::size_t which, std::span<const RefinementNode> nodes,
                  std::span<double> eta) const;

  private:
    std::span<const OwnIndicator> indicators_;
    std::vector<Field> fields_;
    VolumeDescription volume_;
};

/// Nodes of one layer and slot that have no missing value around them: those that are passed to the
/// functions together.
class DiamondBatch {
  public:
    /// For a layer of nx times ny lattice nodes. `volume` is borrowed by the nodes.
    DiamondBatch(std::int64_t nx, std::int64_t ny, const VolumeDescription& volume)
        : elements_(capacity(static_cast<std::uint64_t>(nx), static_cast<std::uint64_t>(ny)) *
                    kMaxDiamond),
          volume_(&volume) {
        nodes_.reserve(elements_.size() / kMaxDiamond);
    }
    /// Bytes held.
    static std::uint64_t heap(std::uint64_t nx, std::uint64_t ny) {
        return capacity(nx, ny) * (kMaxDiamond * sizeof(RefinedElement) + sizeof(RefinementNode) +
                                   sizeof(double) + 2 * sizeof(std::int64_t));
    }
    /// Whether `more` nodes can be added.
    [[nodiscard]] bool has_room(std::int64_t more) const {
        return (nodes_.size() + static_cast<std::size_t>(more)) * kMaxDiamond <= elements_.size();
    }
    void clear() {
        nodes_.clear();
        places_.clear();
        used_ = 0;
    }

    /// Adds the node in `slot` of lattice node `owner` of the level, at (i, j) in its layer.
    /// value(p) is the value at node p of the lattice of stride 2^(level - 1); `cells`: cubes
    /// (squares, edges) of the level per axis. Returns false, and adds nothing, if a value is not
    /// finite.
    template <class Value>
    bool add(const Int3& owner, int slot, int level, unsigned flat, const Int3& cells,
             std::int64_t i, std::int64_t j, const Value& value) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        const Int3 o = slot_offset(slot);
        const Int3 at = owner * 2 + o;
        const auto parities =
            static_cast<unsigned>((owner.x & 1) + 2 * (owner.y & 1) + 4 * (owner.z & 1)) & ~flat;
        const NodeInfo info = describe_node(at, 1);
        RefinementNode node;
        node.volume = volume_;
        node.node = at * scale;
        node.ends = {info.end0 * scale, info.end1 * scale};
        node.level = level;
        node.odd_axes = static_cast<int>(o.x + o.y + o.z);
        node.value = value(at);
        bool finite = std::isfinite(node.value);
        RefinedElement* const first = elements_.data() + used_;
        std::size_t count = 0;
        for (const DiamondElement& around : diamond(slot, parities, flat)) {
            const Int3 cube = owner + around.cube;
            if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} ||
                max(cube + Int3{1, 1, 1}, cells) != cells) {
                continue;
            }
            RefinedElement& element = first[count++];
            element.count = around.vertices;
            const std::size_t turned = at + around.v[0] == info.end0 ? 0 : 1;
            for (std::size_t v = 0; v < static_cast<std::size_t>(around.vertices); ++v) {
                const Int3 vertex = at + around.v[v < 2 ? v ^ turned : v];
                element.vertices[v] = vertex * scale;
                element.values[v] = value(vertex);
                finite = finite && std::isfinite(element.values[v]);
            }
        }
        if (!finite) {
            return false;
        }
        node.end_values = {first->values[0], first->values[1]};
        node.elements = {first, count};
        used_ += count;
        nodes_.push_back(node);
        places_.emplace_back(i, j);
        return true;
    }

    /// Calls put(i, j, eta) for each node.
    template <class Put>
    void evaluate(const OwnIndicators& own, std::size_t which, const Put& put) {
        eta_.resize(nodes_.size());
        own.evaluate(which, nodes_, eta_);
        for (std::size_t n = 0; n < nodes_.size(); ++n) {
            put(places_[n].first, places_[n].second, eta_[n]);
        }
    }

  private:
    /// At least a row, at most a layer, and about a thousand nodes, so that calls cost little.
    static std::uint64_t capacity(std::uint64_t nx, std::uint64_t ny) {
        constexpr std::uint64_t kEnough = 1024;
        return std::max(nx, std::min(nx * ny, kEnough));
    }

    std::vector<RefinedElement> elements_;
    std::vector<RefinementNode> nodes_;
    std::vector<std::pair<std::int64_t, std::int64_t>> places_;
    std::vector<double> eta_;
    std::size_t used_ = 0;
    const VolumeDescription* volume_;
};

}  // namespace isonest::detail
