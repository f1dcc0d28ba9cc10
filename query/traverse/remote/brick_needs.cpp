#include "query/traverse/remote/brick_needs.h"

#include <algorithm>
#include <array>
#include <bit>
#include <bitset>
#include <optional>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_tests.h"
#include "query/values/blocks.h"
#include "query/values/brick_view.h"
#include "query/values/topology.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr Int3 kThree{3, 3, 3};

/// Bits of the refinement nodes that may be tested if the tetrahedra in `mask` are refined.
std::uint32_t asked_nodes(std::uint8_t mask) {
    const Topology& tables = topology();
    std::uint32_t nodes = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) == 0) {
            continue;
        }
        for (const std::uint8_t face : tables.cube[order].children) {
            nodes |= 1U << tables.face[face].ref_node;
            for (const std::uint8_t edge : tables.face[face].children) {
                nodes |= 1U << tables.edge[edge].ref_node;
            }
        }
    }
    return nodes;
}

/// Bits of the last refinement nodes before the subcubes if the tetrahedra in `mask` are refined.
std::uint32_t edge_nodes(std::uint8_t mask) {
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

/// What is known about the stop test in a brick before more of it is loaded: the indicators of the
/// level above were already decoded where they are its parents' centres.
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
    /// relative to the brick's first.
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
    /// At a node of the brick's level, relative to its first node.
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

/// The chunks that the cubes of a list use. A slot (bits x, y, z) is the next chunk after the
/// brick's along these axes.
class Reach {
  public:
    Reach(const TraversalRun& run, int level, const Int3& brick)
        : query_(run.query),
          level_(level),
          brick_(brick),
          half_(run.layout().header().chunk / 2),
          edge_(std::int64_t{2} << level),
          stops_(run, level, brick) {
        const Int3 low = brick * (2 * half_) * (edge_ / 2);
        is_inside_ =
            overlap_of(query_.box, low, low + Int3{1, 1, 1} * (half_ * edge_)) == Overlap::inside;
    }

    void add(const MaskList& masks, std::size_t begin) {
        const Int3 first = brick_ * half_;
        const auto [from, to] =
            query_.share.meeting(level_ + 1, morton_code(first) + begin, masks.size());
        for (std::size_t i = from; i < to; ++i) {
            if (masks[i] == 0) {
                continue;
            }
            const Int3 local = morton_point(begin + i);
            const Int3 cube = first + local;
            if (is_inside_ || overlap_of(query_.box, cube * edge_,
                                         (cube + Int3{1, 1, 1}) * edge_) != Overlap::outside) {
                add(local, cube, masks[i]);
            }
        }
    }

    [[nodiscard]] bool empty() const { return combinations_.none(); }
    /// Chunks with the cubes' nodes.
    [[nodiscard]] std::bitset<8> values() const {
        std::bitset<8> slots;
        for (unsigned both = 0; both < 64; ++both) {
            for (unsigned slot = 0; slot < 8 && combinations_[both]; ++slot) {
                slots[slot] = slots[slot] || (slot & ~(both >> 3U) & 7U) == 0;
            }
        }
        return slots;
    }
    /// Chunks with their refinement nodes, in the indicators of the level above.
    [[nodiscard]] std::bitset<8> fields() const { return fields_; }
    /// The octants of the brick that contain cubes which may be refined to their subcubes, or whose
    /// vertices have errors.
    [[nodiscard]] std::bitset<8> octants() const { return octants_; }
    /// Those of the 3 x 3 x 3 chunks around the brick's that contain nodes for the gradients at the
    /// cubes' nodes.
    [[nodiscard]] std::bitset<27> around() const { return around(combinations_); }
    /// The same on the level above, around the chunk that contains the brick there.
    [[nodiscard]] std::bitset<27> around_above() const { return around(above_); }

  private:
    /// Bits x, y, z of the axes along which a cube is the first of its chunk, plus 8 times the bits
    /// of those along which it is the last.
    using Combinations = std::bitset<64>;

    void add(const Int3& local, const Int3& cube, std::uint8_t mask) {
        const Int3 last{half_ - 1, half_ - 1, half_ - 1};
        const unsigned high = equal_axes(local, last);
        combinations_.set(equal_axes(local, {0, 0, 0}) + 8 * high);
        const Int3 twice = local * 2;
        const auto octant = static_cast<std::size_t>(kOctants.linear(octant_of(twice, half_)));
        octants_[octant] = octants_[octant] || query_.attributes.error.has_value() ||
                           stops_.may_reach_subcubes(cube, local, mask);
        fields_.set(0);
        if (high != 0) {
            const unsigned mirror = mirror_of(cube);
            for (std::uint32_t nodes = asked_nodes(mask); nodes != 0; nodes &= nodes - 1) {
                const Int3& offset = node_offset(std::countr_zero(nodes), mirror);
                fields_.set(high & equal_axes(offset, {2, 2, 2}));
            }
        }
        if (query_.attributes.needs_gradient()) {
            const std::int64_t chunk = 2 * half_;
            const Int3 above{cube.x % chunk, cube.y % chunk, cube.z % chunk};
            above_.set(equal_axes(above, {0, 0, 0}) +
                       8 * (equal_axes(above, {chunk - 1, chunk - 1, chunk - 1}) |
                            equal_axes(above, {chunk - 2, chunk - 2, chunk - 2})));
        }
    }
    static unsigned equal_axes(const Int3& a, const Int3& b) {
        return (a.x == b.x ? 1U : 0U) + (a.y == b.y ? 2U : 0U) + (a.z == b.z ? 4U : 0U);
    }
    static std::bitset<27> around(const Combinations& combinations) {
        std::bitset<27> chunks;
        for (unsigned both = 0; both < 64; ++both) {
            if (!combinations[both]) {
                continue;
            }
            for (std::int64_t i = 0; i < 27; ++i) {
                const Int3 step = kThree.unlinear(i) - Int3{1, 1, 1};
                const unsigned low = equal_axes(step, {-1, -1, -1});
                const unsigned high = equal_axes(step, {1, 1, 1});
                // A difference is along one axis.
                chunks[static_cast<std::size_t>(i)] =
                    chunks[static_cast<std::size_t>(i)] ||
                    (std::popcount(low) <= 1 && (low & ~both & 7U) == 0 &&
                     (high & ~(both >> 3U) & 7U) == 0);
            }
        }
        return chunks;
    }

    const TraversalQuery& query_;
    int level_;
    Int3 brick_;
    std::int64_t half_;
    std::int64_t edge_;  ///< edge of the cubes, in the finest lattice
    KnownStops stops_;
    bool is_inside_ = false;
    Combinations combinations_;
    Combinations above_;
    std::bitset<8> fields_;
    std::bitset<8> octants_;
};

Int3 slot_offset(std::size_t slot) {
    return kOctants.unlinear(static_cast<std::int64_t>(slot));
}

void add_slots(const ArrayInfo& array, const Int3& chunk, const std::bitset<8>& slots,
               ChunkNeeds& needs) {
    for (std::size_t slot = 0; slot < 8; ++slot) {
        if (slots[slot]) {
            needs.add(array, chunk + slot_offset(slot), slot == 0);
        }
    }
}

void add_around(const ArrayInfo& array, const Int3& chunk, const std::bitset<27>& around,
                ChunkNeeds& needs) {
    for (std::int64_t i = 0; i < 27; ++i) {
        if (around[static_cast<std::size_t>(i)]) {
            const Int3 step = kThree.unlinear(i) - Int3{1, 1, 1};
            needs.add(array, chunk + step, step == Int3{0, 0, 0});
        }
    }
}

/// The indicators that a traversal uses in bricks of a level; those of culling are not used in the
/// two finest levels (CullingInBrick).
std::vector<Field> fields_of(const TraversalRun& run, int level) {
    const TraversalQuery& query = run.query;
    constexpr int kMinCulled = 2;
    std::vector<Field> fields;
    if (!query.plane) {
        fields.push_back(query.bound);
    }
    if (!query.tolerance.is_zero()) {
        fields.push_back(query.stop);
    }
    if (query.culling && level >= kMinCulled) {
        fields.push_back(query.culling->field());
    }
    if (query.attributes.error) {
        fields.push_back(*query.attributes.error);
    }
    return fields;
}

/// Adds what vertex attributes need besides the values of the cubes. `has_long_edges`: leaves may
/// have edges of the level above.
void add_attribute_needs(const TraversalRun& run, int level, const Int3& brick, const Reach& reach,
                         bool has_long_edges, TraversalNeeds& needs) {
    const TraversalQuery& query = run.query;
    const StoreLayout& layout = run.layout();
    const Int3 above{brick.x / 2, brick.y / 2, brick.z / 2};
    if (query.attributes.needs_gradient()) {
        add_around(layout.array(level, Field::values), brick, reach.around(), needs.own);
        if (has_long_edges && level < layout.lattice().top()) {
            add_around(layout.array(level + 1, Field::values), above, reach.around_above(),
                       needs.own);
        }
    }
    if (query.attributes.value && query.attribute_values != nullptr) {
        const StoreLayout& other = query.attribute_values->source().layout();
        const std::int64_t k = layout.header().chunk;
        // Chunks of the other store may have a different size.
        const ArrayInfo& array = other.array(level, Field::values);
        Int3 end{k - 1, k - 1, k - 1};
        for (std::size_t slot = 0; slot < 8; ++slot) {
            if (reach.values()[slot]) {
                end = max(end, Int3{k - 1, k - 1, k - 1} + slot_offset(slot));
            }
        }
        const Int3 from = array.chunk_of(brick * k);
        const Int3 last = min(brick * k + end, array.nodes - Int3{1, 1, 1});
        const Int3 size = array.chunk_of(last) - from + Int3{1, 1, 1};
        for (std::int64_t i = 0; i < size.product(); ++i) {
            needs.values.add(array, from + size.unlinear(i), other.header().chunk != k || i == 0);
        }
    }
}

/// Adds the chunk of a node and those of its neighbours, of the values of the finest level.
void add_around_node(const ArrayInfo& values, const Int3& node, ChunkNeeds& needs) {
    needs.add(values, values.chunk_of(node), false);
    for (int axis = 0; axis < 3; ++axis) {
        for (const std::int64_t step : {-1, 1}) {
            Int3 beside = node;
            beside[axis] = std::clamp<std::int64_t>(node[axis] + step, 0, values.nodes[axis] - 1);
            needs.add(values, values.chunk_of(beside), false);
        }
    }
}

}  // namespace

void prefetch(TraversalRun& run, const TraversalNeeds& needs) {
    run.cache.prefetch(needs.own.chunks());
    if (run.query.attribute_values != nullptr) {
        run.query.attribute_values->prefetch(needs.values.chunks());
    }
}

void add_brick_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                     TraversalNeeds& needs) {
    const TraversalRun& run = *runs.front();
    const StoreLayout& layout = run.layout();
    Reach reach(run, level, brick);
    for (const auto& lists : parents) {
        if (lists != nullptr) {
            reach.add(lists->masks, lists->begin);
        }
    }
    if (reach.empty()) {
        return;
    }
    add_slots(layout.array(level, Field::values), brick, reach.values(), needs.own);
    for (const Field field : fields_of(run, level)) {
        const bool is_derived = level == 0 && centre_suffices_at_level_1(field);
        if (!is_derived) {
            add_slots(layout.array(level + 1, field), brick, reach.fields(), needs.own);
        }
        for (std::size_t octant = 0; octant < 8 && level > 0; ++octant) {
            if (reach.octants()[octant]) {
                needs.own.add(layout.array(level, field), child_of(brick, octant));
            }
        }
    }
    add_attribute_needs(run, level, brick, reach, true, needs);
}

bool has_node_needs(const TraversalRun& run, int level) {
    return run.query.attributes.needs_gradient() && level > 0;
}

void add_node_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                    TraversalNeeds& needs) {
    const BrickPlace at(runs.front()->layout(), level, brick);
    const ArrayInfo& finest = runs.front()->layout().array(0, Field::values);
    CubeLoader values(runs.front()->cache, level, at.base);
    for (std::size_t r = 0; r < parents.size(); ++r) {
        if (parents[r] == nullptr) {
            continue;
        }
        for (std::size_t i = 0; i < parents[r]->masks.size(); ++i) {
            const Int3 cube = brick * at.half + morton_point(parents[r]->begin + i);
            const Int3 low = cube * (2 * at.stride);
            if (parents[r]->masks[i] == 0 ||
                overlap_of(runs[r]->query.box, low, low + Int3{2, 2, 2} * at.stride) ==
                    Overlap::outside) {
                continue;
            }
            CubeNodes nodes;
            const std::optional<LatticePlane>& plane = runs[r]->query.plane;
            values.load(nodes, cube);
            for (int position = 0; position < 27; ++position) {
                const Int3 node = (nodes.low + node_offset(position, nodes.mirror)) * at.stride;
                const bool is_vertex =
                    plane ? plane->distance(node) == 0
                          : nodes.value[static_cast<std::size_t>(position)] == runs[r]->query.iso;
                if (is_vertex) {
                    add_around_node(finest, min(node, finest.nodes - Int3{1, 1, 1}), needs.own);
                }
            }
        }
    }
}

void add_top_needs(Runs runs, std::uint64_t max_bytes, TraversalNeeds& needs) {
    const TraversalRun& run = *runs.front();
    const StoreLayout& layout = run.layout();
    for (int level = layout.lattice().top(); level >= 0; --level) {
        const ArrayInfo& values = layout.array(level, Field::values);
        if (values.grid.product() > 1) {
            return;
        }
        TraversalNeeds of_level;
        of_level.own.add(values, {0, 0, 0});
        for (const Field field : fields_of(run, level)) {
            if (level == 0) {
                break;
            }
            const ArrayInfo& array = layout.array(level, field);
            for (std::int64_t i = 0; i < array.grid.product(); ++i) {
                of_level.own.add(array, array.grid.unlinear(i));
            }
        }
        if (level < layout.lattice().top() &&
            needs.own.bytes() + of_level.own.bytes() > max_bytes) {
            return;
        }
        needs.add(of_level);
    }
}

void add_finest_needs(const TraversalRun& run, const Int3& brick, const MaskList& cubes,
                      TraversalNeeds& needs) {
    Reach reach(run, 0, brick);
    reach.add(cubes, 0);
    if (!reach.empty()) {
        add_slots(run.layout().array(0, Field::values), brick, reach.values(), needs.own);
        add_attribute_needs(run, 0, brick, reach, false, needs);
    }
}

}  // namespace isonest::detail
