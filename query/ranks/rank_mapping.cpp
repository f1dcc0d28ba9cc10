// Blocks go out in batches. Two are on their way at a time: while all map one, rank 0 uses what is
// left of the one before and loads the next.
#include "query/ranks/rank_mapping.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <deque>
#include <span>
#include <string>
#include <utility>

#include "query/ranks/block_messages.h"
#include "query/ranks/packed_patch.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {
namespace {

/// Of a batch, if the memory holds them.
constexpr std::uint64_t kBlocksPerThread = 4;
/// Bytes at rank 0 for each triangle of a batch, at most: three batches are there. Of one, the
/// packed patches, and 24 bytes for the vertices' numbers; of the next, those or what is left of
/// rank 0's own (64); of the one before, what is left (64).
constexpr std::uint64_t kHeldBytes = kMostPackedPatch + 24 + 64 + 64;
/// And for each block: GoneTriangles has a number for each of 4,096 bins at most.
constexpr std::uint64_t kHeldPerBlock = std::uint64_t{3} * 4096 * 8;
/// Bytes at the rank that maps it for each triangle of a batch: as it came, and what is left of one
/// of the batch before.
constexpr std::uint64_t kServedBytes = kMostPackedPatch + kMostPackedResult;
constexpr std::uint64_t kServedPerBlock = std::uint64_t{4096} * 8;
/// What loading, packing and using a block of others costs rank 0, in parts of mapping it: measured
/// by isonest_map_mesh (query/DISTANCE.md).
constexpr double kCarrying = 0.065;

/// A block from its loading until it is used.
struct Carried {
    std::int64_t number = 0;
    int rank = 0;  ///< that maps it
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
        // All batches about alike.
        const auto blocks = static_cast<std::uint64_t>(pass.blocks);
        const std::uint64_t most = kBlocksPerThread * threads;
        // NOLINTNEXTLINE(clang-analyzer-core.DivideZero): every rank offers a thread
        const std::uint64_t batches = (blocks + most - 1) / most;
        most_ = batches == 0 ? 1 : (blocks + batches - 1) / batches;
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

    /// The next blocks, each for the rank that would be done with it first.
    Batch plan() {
        Batch batch;
        std::vector<double> busy(offers_.size());
        std::vector<std::uint64_t> held(offers_.size());
        std::uint64_t carried = 0;
        while (planned_ < pass_.blocks && batch.size() < most_) {
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

    /// work(carried) for rank 0's own blocks, or for those of others, in parallel.
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

    /// Rank 0's part of the work between two steps.
    void work(Batch& own, Batch& others) {
        tbb::parallel_invoke([&] { each(own, true, [this](Carried& c) { map(c); }); },
                             [&] { each(others, false, [this](Carried& c) { load(c); }); });
    }

    void use(const Batch& batch) const {
        for (const Carried& c : batch) {
            pass_.use(c.number, c.block);
        }
    }

    /// Sends a batch, and receives what is left of the one before.
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
    std::uint64_t most_ = 1;    ///< blocks in a batch
    std::int64_t planned_ = 0;  ///< blocks until now
};

RankMapping::RankMapping(RankTeam& team, std::uint64_t memory)
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

std::unique_ptr<BlockMapping> mapping_by(RankTeam* team, std::uint64_t memory) {
    if (team == nullptr) {
        return std::make_unique<LocalMapping>();
    }
    return std::make_unique<RankMapping>(*team, memory);
}

}  // namespace isonest::detail
