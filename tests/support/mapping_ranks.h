// Mapping of blocks by ranks that are threads of one process.
#pragma once

#include <cstddef>
#include <vector>

#include "query/extract/extract_query.h"
#include "query/ranks/rank_mapping.h"
#include "tests/support/thread_ranks.h"

namespace isonest::test {

/// Runs work(mapping) on rank 0, while the others serve. Returns what each rank did.
template <class Work>
std::vector<detail::RankWork> map_on_ranks(int size, const ExtractOptions& options,
                                           const Work& work) {
    std::vector<detail::RankWork> done(static_cast<std::size_t>(size));
    ThreadRanks(size).run([&](detail::Communicator& ranks) {
        detail::RankTeam team{ranks};
        if (ranks.rank() == 0) {
            detail::RankMapping mapping(team, detail::memory_of(options, "a mesh"));
            work(mapping);
            mapping.finish();
            ranks.broadcast({});
        } else {
            while (ranks.broadcast({}) == detail::kBlocksToMap) {
                detail::serve_blocks(team, detail::memory_of(options, "a mesh"), silent_progress());
            }
        }
        done[static_cast<std::size_t>(ranks.rank())] = team.work;
    });
    return done;
}

}  // namespace isonest::test
