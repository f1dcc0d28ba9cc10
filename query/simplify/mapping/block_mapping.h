// Who maps the blocks of a mesh: the threads of this process, or those of all ranks
// (query/ranks/rank_mapping.h).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include <isonest/progress.h>

#include "query/simplify/mapping/map_patch.h"

namespace isonest::detail {

/// A block that is simplified by itself.
struct MappedBlock {
    MappedPatch patch;
    std::vector<std::uint64_t> vertex;  ///< of the mesh, for each one of the patch
    GoneTriangles gone_at;
};

/// The blocks of one pass, from 0 on.
struct BlockPass {
    std::int64_t blocks = 0;
    CollapseLimits limits;
    std::function<std::uint64_t(std::int64_t block)> triangles;  ///< in a block. Thread-safe
    std::function<MappedBlock(std::int64_t block)> load;         ///< of each once. Thread-safe
    /// Takes what is left of a block: triangles, displacements and tried of its patch, its vertex
    /// and gone_at. One at a time, in ascending order, also while others are loaded.
    std::function<void(std::int64_t block, const MappedBlock&)> use;
};

/// What map_patch() makes of a block depends on the block and the limits alone, so that meshes are
/// the same, whoever maps. Not thread-safe.
class BlockMapping {
  public:
    BlockMapping() = default;
    BlockMapping(const BlockMapping&) = delete;
    BlockMapping& operator=(const BlockMapping&) = delete;
    virtual ~BlockMapping() = default;

    /// Loads each block, maps it and has it used; what is left is the same as if one thread did so.
    /// Works in the arena of its caller. `progress` is told of the triangles of each block. Throws
    /// Error{cancelled}, and what the functions of the pass throw.
    virtual void map(const BlockPass& pass, Progress& progress) = 0;
    /// No pass follows soon: whoever helps may do something else.
    virtual void finish() {}
    /// Heap that it takes beside map_heap() for each thread.
    [[nodiscard]] virtual std::uint64_t heap() const { return 0; }
};

/// By the threads of this process. Thread-safe.
class LocalMapping : public BlockMapping {
  public:
    void map(const BlockPass& pass, Progress& progress) override;
};

}  // namespace isonest::detail
