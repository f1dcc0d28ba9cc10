// Single nodes of a store, wherever they are: for what few places need, such as mesh vertices.
#pragma once

#include <array>
#include <optional>

#include <isonest/value_type.h>

#include "query/view/brick_view.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Reads values and indicators node by node through the cache, and remembers the last chunk of each
/// level. Not thread-safe; one per thread.
class NodeSampler {
  public:
    /// What a chunk's neighbours need of its values for gradients and for the indicators of level
    /// 1: see ChunkCache.
    static constexpr ChunkSides kSides{3, 1};

    explicit NodeSampler(ChunkCache& cache) : cache_(&cache), layout_(&cache.source().layout()) {}

    /// Until leave(), most nodes are near the chunk of `level` that holds this node of the finest
    /// lattice. That chunk is decoded as a whole and remembered beside the last other one, of which
    /// its sides may do.
    void enter(int level, const Int3& node);
    /// Lets go of all chunks.
    void leave();
    /// How many chunks of values and of an indicator at most are held between enter() and leave()
    /// by one that is asked for the levels of a brick: its own, the next coarser, the finest.
    static constexpr std::uint64_t kMostValueChunks = 4;
    static constexpr std::uint64_t kMostIndicatorChunks = 2;

    /// U at node p of the finest lattice, from the coarsest level up to `level` that has it.
    /// REQUIRES: p is a multiple of 2^level. Nodes outside the volume take the nearest one's value.
    [[nodiscard]] double value(const Int3& p, int level);
    /// The gradient in world units by differences to the nodes 2^level away, one-sided at borders.
    [[nodiscard]] Double3 gradient(const Int3& p, int level);
    /// The field at refinement node x: 0 at nodes that refine nothing. REQUIRES: x >= 0; the store
    /// has the field.
    [[nodiscard]] double indicator(const Int3& x, Field field);
    /// The same from as few values as the node needs. REQUIRES: an element of the grid refines at
    /// x.
    [[nodiscard]] double grid_indicator(const Int3& x, Field field);

  private:
    static constexpr std::size_t kLevels = 22;
    struct Recent {
        const ArrayInfo* array = nullptr;
        Int3 chunk{-1, -1, -1};
        Int3 first{};  ///< node of the chunk
        ChunkPart part;
    };
    void look_at(Recent& recent, int level, Field field);
    const std::byte* element(Recent& recent, const Int3& node, int component);
    double stored(Recent& recent, const Int3& owner, int slot);
    double at_level_1(const Int3& x, const NodeInfo& node, bool plus);
    [[nodiscard]] bool is_home(const ArrayInfo& array, const Int3& chunk) const;

    ChunkCache* cache_;
    const StoreLayout* layout_;
    std::array<Recent, kLevels> values_;
    std::array<Recent, kLevels> indicators_;
    std::optional<int> home_level_;
    Int3 home_chunk_;
    Recent home_;
};

}  // namespace isonest::detail
