#include "query/ranks/serve_blocks.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "query/ranks/block_messages.h"
#include "query/ranks/mapping_step.h"
#include "query/ranks/packed_patch.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {
namespace {

MappingOffer offer_of(const std::string& name, const ExtractOptions& options) {
    require_memory(name, options.memory, kLibraryHeap + map_heap(),
                   "simplification within a distance");
    const std::uint64_t heap = waiting_heap(options.memory);
    return {std::min((options.memory - kLibraryHeap - heap) / map_heap(),
                     static_cast<std::uint64_t>(Workers::count_of(options.threads))),
            heap};
}

}  // namespace

void serve_blocks(RankTeam& team, const std::string& name, const ExtractOptions& options,
                  const Progress& progress) {
    using Clock = std::chrono::steady_clock;
    Communicator& ranks = team.ranks;
    const MappingOffer offer = offer_of(name, options);
    ranks.gather(text_of_value(offer));
    Workers workers(static_cast<int>(offer.threads));
    ++team.work.mappings;
    for (BlockSender results;;) {
        ranks.gather(text_of_value(results.messages(0)));
        const MappingStep step = hear_step(ranks);
        if (step.is_end) {
            return;
        }
        std::vector<std::vector<std::byte>> blocks;
        BlockReceiver receiver;
        ranks.exchange([&](Communicator::Message& message) { return results.next(message); },
                       step.messages[static_cast<std::size_t>(ranks.rank())],
                       [&](int /*from*/, std::span<const std::byte> bytes) {
                           if (auto packed = receiver.take(bytes)) {
                               blocks.push_back(std::move(*packed));
                           }
                       });
        const auto start = Clock::now();
        std::vector<std::uint64_t> triangles(blocks.size());
        workers.execute([&] {
            tbb::parallel_for(
                std::size_t{0}, blocks.size(),
                [&](std::size_t i) {
                    progress.check();
                    ranks.check();
                    MappedPatch patch = unpacked_patch(blocks[i]);
                    blocks[i] = {};
                    triangles[i] = patch.triangles.size();
                    const GoneTriangles gone_at = map_patch(patch, step.limits);
                    blocks[i] = packed_result(patch, gone_at);
                },
                tbb::simple_partitioner());
        });
        team.work.mapping_seconds += std::chrono::duration<double>(Clock::now() - start).count();
        for (std::size_t i = 0; i < blocks.size(); ++i) {
            ++team.work.mapped_blocks;
            team.work.mapped_triangles += triangles[i];
            results.add(0, std::move(blocks[i]));
        }
    }
}

}  // namespace isonest::detail
