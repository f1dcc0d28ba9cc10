// Single nodes of a store, wherever they are: for what few places need, such as mesh vertices.
#pragma once

#include <array>

#include "query/brick_view.h"
#include "store/lattice.h"
#include "store/value_type.h"

namespace isonest {

/// Reads values and indicators node by node through the cache, and remembers the last chunk of each
/// level. Not thread-safe; one per thread.
class NodeSampler {
  public:
    explicit NodeSampler(ChunkCache& cache) : cache_(&cache), layout_(&cache.source().layout()) {}

    /// U at node p of the finest lattice, from the coarsest level up to `level` that has it.
    /// REQUIRES: p is a multiple of 2^level. Nodes outside the volume take the nearest one's value.
    [[nodiscard]] double value(const Int3& p, int level);
    /// The gradient in world units by differences to the nodes 2^level away, one-sided at borders.
    [[nodiscard]] Double3 gradient(const Int3& p, int level);
    /// The field at refinement node x: 0 at nodes that refine nothing. REQUIRES: x >= 0; the store
    /// has the field.
    [[nodiscard]] double indicator(const Int3& x, Field field);

  private:
    static constexpr std::size_t kLevels = 22;
    struct Recent {
        const ArrayInfo* array = nullptr;
        Int3 chunk{-1, -1, -1};
        DecodedChunk data;
    };
    const std::byte* element(Recent& recent, int level, Field field, const Int3& node,
                             int component);

    ChunkCache* cache_;
    const StoreLayout* layout_;
    std::array<Recent, kLevels> values_;
    std::array<Recent, kLevels> indicators_;
};

}  // namespace isonest
