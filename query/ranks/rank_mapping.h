// The blocks of a mesh are mapped by all ranks. Rank 0 has the mesh: it loads the blocks, sends
// those that are others' to them, and puts together what is left of each in the order of the
// blocks, so that the mesh has the same bytes for any number of ranks.
#pragma once

#include <cstdint>
#include <vector>

#include "query/ranks/mapping_step.h"
#include "query/simplify/mapping/block_mapping.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Rank 0's side; serve_blocks() is that of all others. Not thread-safe.
class RankMapping : public BlockMapping {
  public:
    /// `memory`: of rank 0, of which heap() is a part. Collective. REQUIRES: `ranks` is rank 0's,
    /// and stays.
    RankMapping(Communicator& ranks, std::uint64_t memory);

    /// Collective, as finish() is. Throws Error{cancelled} if another rank has failed, too.
    void map(const BlockPass& pass, Progress& progress) override;
    /// Of blocks that are others', and of what is left of blocks until it is used. Blocks for which
    /// that is too little are mapped one after the other, by rank 0.
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }
    /// There will be no other pass: serve_blocks() returns. Called once.
    void finish();

  private:
    class Pass;

    Communicator& ranks_;
    std::uint64_t heap_;
    std::vector<MappingOffer> offers_;  ///< of the ranks from 1 on; rank 0's is not asked
};

}  // namespace isonest::detail
