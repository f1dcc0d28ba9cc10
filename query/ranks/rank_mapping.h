// The blocks of a mesh are mapped by all ranks. Rank 0 has the mesh: it loads the blocks, sends
// those that are others' to them, and puts together what is left of each in the order of the
// blocks, so that the mesh has the same bytes for any number of ranks.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "query/ranks/mapping_step.h"
#include "query/ranks/rank_team.h"
#include "query/simplify/mapping/block_mapping.h"

namespace isonest::detail {

/// The text that rank 0 broadcasts to make the others call serve_blocks().
inline constexpr std::string_view kBlocksToMap = "blocks to map";

/// Rank 0's side; serve_blocks() is that of all others. Not thread-safe.
class RankMapping : public BlockMapping {
  public:
    /// `memory`: of rank 0, of which heap() is a part. REQUIRES: `team` is rank 0's, and stays.
    RankMapping(RankTeam& team, std::uint64_t memory);

    /// Collective; the first one broadcasts kBlocksToMap before. Throws Error{cancelled} if another
    /// rank has failed, too.
    void map(const BlockPass& pass, Progress& progress) override;
    /// Collective if anything was mapped: serve_blocks() returns.
    void finish() override;
    /// Of blocks that are others', and of what is left of blocks until it is used. Blocks for which
    /// that is too little are mapped one after the other, by rank 0.
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }

  private:
    class Pass;

    RankTeam& team_;
    std::uint64_t heap_;
    std::vector<MappingOffer> offers_;  ///< of the ranks, once they serve; rank 0's is not asked
};

/// Who maps the blocks of an extraction that has so much memory: all ranks of `team`, or, without
/// one, the threads of this process.
std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, std::uint64_t memory);

}  // namespace isonest::detail
