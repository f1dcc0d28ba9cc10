// Blocks are sent in batches, and two batches are in progress at a time: while all ranks map one,
// rank 0 uses the results of the previous one and loads the next.

#include "query/ranks/rank_mapping.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "query/ranks/packed_patch.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {
namespace {

struct StepHead {
    bool is_end = false;
    CollapseLimits limits;
};

}  // namespace

void tell_step(Communicator& ranks, const MappingStep& step) {
    std::string text = text_of_value(StepHead{step.is_end, step.limits});
    for (const std::uint64_t messages : step.messages) {
        text += text_of_value(messages);
    }
    ranks.broadcast(std::move(text));
}

MappingStep hear_step(Communicator& ranks) {
    const std::string text = ranks.broadcast({});
    std::string_view rest = text;
    const auto head = value_of_text<StepHead>(rest);
    MappingStep step{head.is_end, head.limits, {}};
    for (rest.remove_prefix(sizeof(StepHead)); !rest.empty();
         rest.remove_prefix(sizeof(std::uint64_t))) {
        step.messages.push_back(value_of_text<std::uint64_t>(rest));
    }
    return step;
}

namespace {

/// The part of the memory for waiting blocks: a quarter, if the rest is enough for a thread.
std::uint64_t waiting_heap(const MemoryShare& memory) {
    constexpr std::uint64_t kPart = 4;
    const std::uint64_t left = memory.left();
    return left <= map_heap() ? 0 : std::min(left / kPart, left - map_heap());
}

MappingOffer offer_of(const MemoryShare& memory) {
    const std::uint64_t heap = waiting_heap(memory);
    const int threads =
        memory.without(heap).threads_of(map_heap(), "simplification within a distance");
    return {static_cast<std::uint64_t>(threads), heap};
}

}  // namespace

void serve_blocks(RankTeam& team, const MemoryShare& memory, const Progress& progress) {
    using Clock = std::chrono::steady_clock;
    Communicator& ranks = team.ranks;
    const MappingOffer offer = offer_of(memory);
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

namespace {

/// Blocks per batch, if the memory allows.
constexpr std::uint64_t kBlocksPerThread = 4;
/// Maximum bytes on rank 0 per triangle of a batch: three batches are held. Of one, the packed
/// patches, and 24 bytes for the vertices' numbers; of the next, the same or rank 0's own results
/// (64); of the previous one, the results (64).
constexpr std::uint64_t kHeldBytes = kMaxPackedPatch + 24 + 64 + 64;
/// And per block: GoneTriangles has at most a number for each of 4,096 bins.
constexpr std::uint64_t kHeldPerBlock = std::uint64_t{3} * 4096 * 8;
/// Bytes on the mapping rank per triangle of a batch: as received, and the result of a triangle of
/// the previous batch.
constexpr std::uint64_t kServedBytes = kMaxPackedPatch + kMaxPackedResult;
constexpr std::uint64_t kServedPerBlock = std::uint64_t{4096} * 8;
/// Rank 0's cost of loading, packing and using a block of another rank, relative to mapping it:
/// measured by isonest_map_mesh (query/DISTANCE.md).
constexpr double kCarrying = 0.065;

/// A block from its loading until it is used.
struct Carried {
    std::int64_t number = 0;
    int rank = 0;  ///< the rank that maps it
    std::uint64_t triangles = 0;
    MappedBlock block;
    std::vector<std::byte> packed;
};
using Batch = std::vector<Carried>;

}  // namespace

class RankMapping::Pass {
  public:
    Pass(RankTeam& team, const std::vector<MappingOffer>& offers, std::uint64_t heap,
         const BlockPass& pass, Progress& progress)
        : ranks_(team.ranks),
          work_(team.work),
          offers_(offers),
          heap_(heap),
          pass_(pass),
          progress_(progress) {
        std::uint64_t threads = 0;
        for (const MappingOffer& offer : offers_) {
            threads += offer.threads;
        }
        // All batches of about the same size.
        const auto blocks = static_cast<std::uint64_t>(pass.blocks);
        const std::uint64_t most = kBlocksPerThread * threads;
        // NOLINTNEXTLINE(clang-analyzer-core.DivideZero): every rank offers a thread
        const std::uint64_t batches = (blocks + most - 1) / most;
        max_ = batches == 0 ? 1 : (blocks + batches - 1) / batches;
    }

    void run() {
        Batch next = plan();
        each(next, false, [this](Carried& c) { load(c); });
        Batch mapped;
        while (!next.empty() || !mapped.empty()) {
            step(next, mapped);
            const Batch left = std::exchange(mapped, std::exchange(next, plan()));
            const auto start = Clock::now();
            tbb::parallel_invoke([&] { use(left); }, [&] { work(mapped, next); });
            work_.mapping_seconds += std::chrono::duration<double>(Clock::now() - start).count();
            for (const Carried& c : mapped) {
                work_.mapped_blocks += c.rank == 0 ? 1 : 0;
                work_.mapped_triangles += c.rank == 0 ? c.triangles : 0;
            }
        }
    }

  private:
    using Clock = std::chrono::steady_clock;

    /// The next blocks, each assigned to the rank that would finish it first.
    Batch plan() {
        Batch batch;
        std::vector<double> busy(offers_.size());
        std::vector<std::uint64_t> held(offers_.size());
        std::uint64_t carried = 0;
        while (planned_ < pass_.blocks && batch.size() < max_) {
            const std::uint64_t triangles = pass_.triangles(planned_);
            const std::uint64_t bytes = triangles * kHeldBytes + kHeldPerBlock;
            const std::uint64_t served = triangles * kServedBytes + kServedPerBlock;
            const bool is_alone = bytes > heap_;
            if (!batch.empty() && carried + bytes > heap_) {
                break;
            }
            const auto end_of = [&](std::size_t rank) {
                return busy[rank] +
                       static_cast<double>(triangles) / static_cast<double>(offers_[rank].threads);
            };
            std::size_t first = 0;
            for (std::size_t rank = 1; rank < offers_.size() && !is_alone; ++rank) {
                if (held[rank] + served <= offers_[rank].heap && end_of(rank) < end_of(first)) {
                    first = rank;
                }
            }
            busy[first] = end_of(first);
            held[first] += served;
            if (first != 0) {
                busy[0] += kCarrying * static_cast<double>(triangles) /
                           static_cast<double>(offers_[0].threads);
            }
            carried += bytes;
            batch.push_back({planned_, static_cast<int>(first), triangles, {}, {}});
            ++planned_;
        }
        return batch;
    }

    /// Calls work(carried) for rank 0's own blocks, or for those of other ranks, in parallel.
    template <class Work>
    void each(Batch& batch, bool is_own, const Work& work) {
        tbb::parallel_for(
            std::size_t{0}, batch.size(),
            [&](std::size_t i) {
                if ((batch[i].rank == 0) == is_own) {
                    progress_.check();
                    ranks_.check();
                    work(batch[i]);
                }
            },
            tbb::simple_partitioner());
    }

    void load(Carried& c) const {
        c.block = pass_.load(c.number);
        c.packed = packed_patch(c.block.patch);
        c.block.patch = {};
    }

    void map(Carried& c) const {
        c.block = pass_.load(c.number);
        MappedPatch& patch = c.block.patch;
        c.block.gone_at = map_patch(patch, pass_.limits);
        patch.positions = {};
        patch.shared = {};
        patch.next_copy = {};
        progress_.advance(c.triangles);
    }

    /// Rank 0's work between two steps.
    void work(Batch& own, Batch& others) {
        tbb::parallel_invoke([&] { each(own, true, [this](Carried& c) { map(c); }); },
                             [&] { each(others, false, [this](Carried& c) { load(c); }); });
    }

    void use(const Batch& batch) const {
        for (const Carried& c : batch) {
            pass_.use(c.number, c.block);
        }
    }

    /// Sends a batch, and receives the results of the previous one.
    void step(Batch& batch, Batch& before) {
        std::uint64_t expected = 0;
        for (const std::string& messages : ranks_.gather({})) {
            expected += value_of_text<std::uint64_t>(messages);
        }
        BlockSender sender;
        for (Carried& c : batch) {
            if (c.rank != 0) {
                sender.add(c.rank, std::move(c.packed));
            }
        }
        MappingStep plan{false, pass_.limits, {}};
        for (int rank = 0; rank < ranks_.size(); ++rank) {
            plan.messages.push_back(sender.messages(rank));
        }
        tell_step(ranks_, plan);
        std::vector<std::deque<Carried*>> waiting(offers_.size());
        for (Carried& c : before) {
            waiting[static_cast<std::size_t>(c.rank)].push_back(&c);
        }
        std::vector<BlockReceiver> receivers(offers_.size());
        ranks_.exchange([&](Communicator::Message& message) { return sender.next(message); },
                        expected,
                        [&](int from, std::span<const std::byte> bytes) {
                            const auto rank = static_cast<std::size_t>(from);
                            if (const auto packed = receivers[rank].take(bytes)) {
                                Carried& c = *waiting[rank].front();
                                waiting[rank].pop_front();
                                unpack_result(*packed, c.block);
                                progress_.advance(c.triangles);
                            }
                        });
    }

    Communicator& ranks_;
    RankWork& work_;
    const std::vector<MappingOffer>& offers_;
    std::uint64_t heap_;
    const BlockPass& pass_;
    Progress& progress_;
    std::uint64_t max_ = 1;     ///< blocks in a batch
    std::int64_t planned_ = 0;  ///< number of blocks planned so far
};

RankMapping::RankMapping(RankTeam& team, const MemoryShare& memory)
    : team_(team), heap_(team.ranks.size() > 1 ? waiting_heap(memory) : 0) {}

void RankMapping::map(const BlockPass& pass, Progress& progress) {
    if (team_.ranks.size() == 1) {
        LocalMapping().map(pass, progress);
        return;
    }
    if (offers_.empty()) {
        ++team_.work.mappings;
        team_.ranks.broadcast(std::string(kBlocksToMap));
        for (const std::string& offer : team_.ranks.gather({})) {
            offers_.push_back(value_of_text<MappingOffer>(offer));
        }
    }
    offers_.front().threads = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
    Pass(team_, offers_, heap_, pass, progress).run();
}

void RankMapping::finish() {
    if (!offers_.empty()) {
        team_.ranks.gather({});
        tell_step(team_.ranks, {true, {}, {}});
        offers_.clear();
    }
}

std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, const MemoryShare& memory) {
    if (team == nullptr) {
        return std::make_unique<LocalMapping>();
    }
    return std::make_unique<RankMapping>(*team, memory);
}

}  // namespace isonest::detail
