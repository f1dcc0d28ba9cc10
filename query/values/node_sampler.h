// Single nodes of a store at any position, for uses with few nodes such as mesh vertices.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/value_type.h>

#include "query/values/blocks.h"
#include "query/values/brick_view.h"
#include "store/base/box.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Reads values and indicators node by node through the cache, and remembers the last chunk of each
/// level. Not thread-safe; one per thread.
class NodeSampler {
  public:
    /// The sides of a chunk's values that its neighbours need for gradients and for the indicators
    /// of level 1: see ChunkCache.
    static constexpr ChunkSides kSides{3, 1};

    explicit NodeSampler(ChunkCache& cache)
        : cache_(&cache),
          layout_(&cache.source().layout()),
          steps_(layout_->header().steps()),
          type_(layout_->header().type),
          outward_(layout_->rounds_outward()),
          top_(layout_->lattice().top()) {}

    /// Until leave(), most nodes are near the chunk of `level` that contains this node of the
    /// finest lattice. That chunk is decoded as a whole and kept, besides the most recently used
    /// other chunk, of which perhaps only the sides are decoded.
    void enter(int level, const Int3& node);
    /// Releases all chunks.
    void leave();
    /// Maximum number of chunks of values and of an indicator held between enter() and leave() if
    /// the levels of a brick are requested: its own, the next coarser, the finest.
    static constexpr std::uint64_t kMaxValueChunks = 4;
    static constexpr std::uint64_t kMaxIndicatorChunks = 2;

    /// U at node p of the finest lattice, from the coarsest level that has it, or `level` at the
    /// finest. REQUIRES: p is a multiple of 2^level. Nodes outside the volume get the value of the
    /// nearest node.
    [[nodiscard]] double value(const Int3& p, int level);
    /// The gradient in world units by differences of the nodes 2^level away, one-sided at borders.
    [[nodiscard]] Double3 gradient(const Int3& p, int level);
    /// The field at refinement node x: 0 at nodes that refine nothing. REQUIRES: x >= 0; the store
    /// has the field.
    [[nodiscard]] double indicator(const Int3& x, Field field);
    /// The same, reading only the values that the node needs. REQUIRES: an element of the grid is
    /// refined at x.
    [[nodiscard]] double grid_indicator(const Int3& x, Field field);

  private:
    static constexpr std::size_t kLevels = 22;
    struct Recent {
        const ArrayInfo* array = nullptr;
        Int3 chunk{-1, -1, -1};
        Int3 first{};  ///< node of the chunk
        ChunkPart part;
        /// If the whole chunk is here: its bytes, and its nodes in the lattice.
        const std::byte* whole = nullptr;
        Int3 size{};

        /// The element of a node if the whole chunk is here and has it; else null.
        [[nodiscard]] const std::byte* find(const Int3& node) const {
            const Int3 p = node - first;
            const auto below = [](std::int64_t at, std::int64_t end) {
                return static_cast<std::uint64_t>(at) < static_cast<std::uint64_t>(end);
            };
            if (!below(p.x, size.x) || !below(p.y, size.y) || !below(p.z, size.z)) {
                return nullptr;
            }
            return whole + (p.x * bytes.x + p.y * bytes.y + p.z * bytes.z);
        }
        Int3 bytes{};  ///< from a node to the next along each axis
    };
    void look_at(Recent& recent, int level, Field field) {
        if (recent.array == nullptr || recent.array->field != field) {
            recent = {};
            recent.array = &layout_->array(level, field);
        }
    }
    const std::byte* element(Recent& recent, const Int3& node, int component);
    double stored(Recent& recent, const Int3& owner, int slot);
    double at_level_1(const Int3& x, bool plus);
    double computed_at_level_1(const Int3& x, bool plus);
    [[nodiscard]] bool is_home(const ArrayInfo& array, const Int3& chunk) const;

    ChunkCache* cache_;
    const StoreLayout* layout_;
    LatticeSteps steps_;
    ValueType type_;
    bool outward_;
    int top_;
    std::array<Recent, kLevels> values_;
    std::array<Recent, kLevels> indicators_;
    std::optional<int> home_level_;
    Int3 home_chunk_;
    Recent home_;
    /// Level-1 numbers that were computed last: the elements around a node ask for the same one.
    /// Allocated when first used.
    struct Computed {
        std::uint64_t key = 0;  ///< of the node and the saturation; 0: nothing
        double number = 0;
    };
    static constexpr std::size_t kComputed = 4096;
    std::vector<Computed> computed_;
};

// An indicator's values at nodes in a box of the finest lattice.

/// Sets the field at the refinement nodes in `box` that belong to `level` or a coarser one; other
/// nodes are not changed. The box may extend beyond the volume, where elements do. Throws what
/// ChunkCache throws, and Error{not_found} if the store lacks the field.
void fill_indicators(ChunkCache& cache, Field field, int level, Box<double>& box);

/// Heap of fill_indicators() for a box of kBlockEdge^3 nodes, including the box, in addition to the
/// decoded chunks.
inline constexpr std::uint64_t kIndicatorBoxHeap =
    2 * sizeof(double) * (kBlockEdge + 3) * (kBlockEdge + 3) * (kBlockEdge + 3);

}  // namespace isonest::detail
