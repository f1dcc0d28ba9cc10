// Blocks that ranks map which are threads of one process.
#pragma once

#include <cstddef>
#include <vector>

#include "query/ranks/rank_mapping.h"
#include "query/ranks/serve_blocks.h"
#include "tests/support/thread_ranks.h"

namespace isonest::test {

/// work(mapping) on rank 0, while the others serve. What each rank did for it.
template <class Work>
std::vector<detail::RankWork> map_on_ranks(int size, const ExtractOptions& options,
                                           const Work& work) {
    std::vector<detail::RankWork> done(static_cast<std::size_t>(size));
    ThreadRanks(size).run([&](detail::Communicator& ranks) {
        detail::RankTeam team{ranks};
        if (ranks.rank() == 0) {
            detail::RankMapping mapping(team, options.memory);
            work(mapping);
            mapping.finish();
            ranks.broadcast({});
        } else {
            while (ranks.broadcast({}) == detail::kBlocksToMap) {
                detail::serve_blocks(team, "a mesh", options, silent_progress());
            }
        }
        done[static_cast<std::size_t>(ranks.rank())] = team.work;
    });
    return done;
}

}  // namespace isonest::test
