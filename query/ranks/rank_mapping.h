// Maps the blocks of a mesh on all ranks. Rank 0 has the mesh: it loads the blocks, sends their
// blocks to the other ranks, and combines the results in the order of the blocks, so the mesh has
// the same bytes for any number of ranks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "query/ranks/cube_shares.h"
#include "query/simplify/collapse/map_mesh.h"
#include "query/simplify/patch.h"
#include "store/base/memory.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

// The messages between rank 0, which has the mesh, and the other ranks when they map the blocks of
// a mesh together.
//
//     once:       rank 0 announces blocks to map                   broadcast
//                 each rank announces its resources                gather
//     each step:  each rank announces the messages of its results  gather
//                 rank 0 announces what follows, or the end        broadcast
//                 results to rank 0, next blocks to the others     exchange
//
// Between two steps all ranks map; rank 0 meanwhile prepares the blocks after the next ones.

/// The resources of a rank for blocks of others.
struct MappingOffer {
    std::uint64_t threads = 0;
    std::uint64_t heap = 0;  ///< for waiting blocks, in addition to map_heap() for each thread
};

/// What rank 0 sends to all others in each step.
struct MappingStep {
    bool is_end = false;
    CollapseLimits limits;                ///< for the following blocks
    std::vector<std::uint64_t> messages;  ///< number of messages for each rank
};

template <class T>
std::string text_of_value(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

template <class T>
T value_of_text(std::string_view text) {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    std::memcpy(&value, text.data(), std::min(sizeof(value), text.size()));
    return value;
}

/// Collective, on rank 0.
void tell_step(Communicator& ranks, const MappingStep& step);
/// Collective, on the others.
MappingStep hear_step(Communicator& ranks);

// The side of the ranks without the mesh when all ranks map blocks.

/// Call after rank 0 has broadcast kBlocksToMap. Maps the blocks sent by its RankMapping until that
/// is finished, with the threads and within the memory; a quarter is for waiting blocks.
/// Collective. REQUIRES: `team` is not rank 0's. Throws Error{cancelled} if another rank has
/// failed, Error{limit} if the memory is too small for a block.
void serve_blocks(RankTeam& team, const MemoryShare& memory, const Progress& progress);

/// The text that rank 0 broadcasts to make the others call serve_blocks().
inline constexpr std::string_view kBlocksToMap = "blocks to map";

/// The side of rank 0; the other ranks call serve_blocks(). Not thread-safe.
class RankMapping : public BlockMapping {
  public:
    /// `memory`: of rank 0, including heap(). REQUIRES: `team` is rank 0's, and outlives this
    /// object.
    RankMapping(RankTeam& team, const MemoryShare& memory);

    /// Collective; the first call broadcasts kBlocksToMap before. Also throws Error{cancelled} if
    /// another rank has failed.
    void map(const BlockPass& pass, Progress& progress) override;
    /// Collective if anything was mapped: serve_blocks() returns.
    void finish() override;
    /// Heap of blocks for other ranks, and of results until they are used. Blocks for which it is
    /// too small are mapped one after another, by rank 0.
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }

  private:
    class Pass;

    RankTeam& team_;
    std::uint64_t heap_;
    std::vector<MappingOffer> offers_;  ///< of the ranks, once they serve; not of rank 0
};

/// The mapping for an extraction with so much memory: by all ranks of `team` or, without a team, by
/// the threads of this process.
std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, const MemoryShare& memory);

}  // namespace isonest::detail
