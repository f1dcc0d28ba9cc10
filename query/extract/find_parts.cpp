#include "query/extract/find_parts.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <vector>

#include "query/apart/parts_apart.h"
#include "query/distance/traverse_within_distance.h"
#include "query/extract/stages/apart_stage.h"
#include "query/extract/stages/distance_limits.h"
#include "query/ranks/cube_shares.h"
#include "query/ranks/gathered_parts.h"
#include "query/traverse/hexahedra/traverse_quadrilaterals.h"
#include "query/traverse/planar.h"
#include "query/view/label_view.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

using Clock = std::chrono::steady_clock;

/// Everything that a traversal needs.
struct TraversalSetting {
    const StoreReader& store;
    const ExtractQuery& asked;
    const TraversalQuery& query;  ///< of `asked`, with the cache of the vertex values
    ChunkCache& cache;
    std::size_t part_vertices;
    const ScratchFolder& scratch;
    Progress& progress;
};

TraversalCounts counts_within_distance(const TraversalSetting& s, const PartSink& sink,
                                       ExtractReport& report) {
    TraversalCounts counts =
        traverse_within_distance(s.cache, s.query, nested_limit_of(s.store, s.asked), s.scratch,
                                 s.part_vertices, sink, s.progress);
    report.distance->bound = counts.error_bound;
    counts.error_bound = 0;
    return counts;
}

/// By what is extracted, and its cells.
TraversalCounts counts_of(const TraversalSetting& s, const PartSink& sink, ExtractReport& report) {
    if (s.asked.nested_distance) {
        return counts_within_distance(s, sink, report);
    }
    switch (s.asked.product) {
        case Product::graph:
            return s.query.cells == Cells::hexahedra
                       ? traverse_quadrilaterals(s.cache, s.query, s.part_vertices, sink,
                                                 s.progress)
                       : traverse_planar(s.cache, s.query, PlanarKind::graph, s.part_vertices, sink,
                                         s.progress);
        case Product::isolines:
            return traverse_planar(s.cache, s.query, PlanarKind::isolines, s.part_vertices, sink,
                                   s.progress);
        case Product::surface:
        case Product::slice:
        case Product::contours:
            break;
    }
    return traverse(s.cache, s.query, s.part_vertices, sink, s.progress);
}

std::vector<double> isovalues_of(std::span<const FoundParts> found) {
    std::vector<double> isovalues;
    std::transform(found.begin(), found.end(), std::back_inserter(isovalues),
                   [](const FoundParts& f) { return f.iso; });
    return isovalues;
}

/// Of each isovalue. Surfaces come out of one traversal; others are traversed in turn, from one
/// cache.
std::vector<TraversalCounts> all_counts(const TraversalSetting& s,
                                        std::span<const FoundParts> found,
                                        std::span<const PartSink> sinks) {
    std::vector<TraversalCounts> counts;
    if (s.asked.product == Product::surface && !s.asked.nested_distance && found.size() > 1) {
        return traverse_isovalues(s.cache, s.query, isovalues_of(found), s.part_vertices, sinks,
                                  s.progress);
    }
    for (std::size_t i = 0; i < found.size(); ++i) {
        TraversalQuery query = s.query;
        query.iso = found[i].iso;
        counts.push_back(
            counts_of({s.store, s.asked, query, s.cache, s.part_vertices, s.scratch, s.progress},
                      sinks[i], *found[i].report));
    }
    return counts;
}

/// The largest error at which a leaf stopped, and what was rounded.
void report_errors(const ExtractQuery& asked, const TraversalCounts& counts,
                   ExtractReport& report) {
    const Indicator indicator = indicator_of(asked.traversal.stop);
    const bool is_error = indicator == Indicator::deviation || indicator == Indicator::linf;
    report.error_bound = asked.traversal.vertices == VertexPlace::exact && is_error
                             ? 2 * counts.error_bound
                             : counts.error_bound;
    report.value_rounding = counts.value_rounding.sum();
    // Laid flat, heights say nothing of the values.
    if (asked.product == Product::graph && counts.height_rounding > 0 && asked.graph_scale != 0) {
        report.value_rounding = counts.height_rounding / std::fabs(asked.graph_scale);
    }
}

double elapsed_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

/// What one traversal did.
struct Traversed {
    TraversalCounts counts;
    std::uint64_t chunks_read = 0;
    std::uint64_t bytes_read = 0;
    std::uint64_t peak_cache_bytes = 0;
};

/// What all ranks did together.
Traversed of_all(Communicator& ranks, const Traversed& own) {
    std::array sums{own.counts.visited, own.counts.leaves, own.counts.bricks, own.chunks_read,
                    own.bytes_read};
    std::array largest{own.counts.error_bound, own.counts.value_rounding.at_edges,
                       own.counts.value_rounding.at_cuts, own.counts.height_rounding,
                       static_cast<double>(own.peak_cache_bytes)};
    ranks.sum(sums);
    ranks.largest(largest);
    return {{sums[0], sums[1], sums[2], largest[0], {largest[1], largest[2]}, largest[3]},
            sums[3],
            sums[4],
            static_cast<std::uint64_t>(largest[4])};
}

}  // namespace

void watch_vertices(const ExtractQuery& asked, PartStore& parts) {
    if (asked.keeps_apart()) {
        parts.watch(
            {sight_apart(asked.coordinate_rounding, asked.least_apart), asked.traversal.box});
    }
    if (asked.traversal.attributes.normal) {
        parts.count_normals();
    }
}

TraversalBudget parts_budget(const StoreReader& store, const ExtractQuery& query,
                             const ExtractOptions& options, std::uint64_t isovalues) {
    if (!query.nested_distance) {
        return share_memory(store, query.traversal, query.values, options.memory, 0,
                            options.threads, true, isovalues);
    }
    // The threads that go with a distance need heap of their own.
    const std::uint64_t each = distance_traversal_heap(store.layout(), query.traversal);
    const std::uint64_t count =
        std::clamp<std::uint64_t>(options.memory / 2 / each, 1,
                                  static_cast<std::uint64_t>(Workers::count_of(options.threads)));
    return share_memory(store, query.traversal, query.values, options.memory, each * count,
                        static_cast<int>(count), true, isovalues);
}

void find_parts(const StoreReader& store, const ExtractQuery& asked, const TraversalBudget& budget,
                std::span<FoundParts> found, const ScratchFolder& scratch, Progress& progress,
                RankTeam* team) {
    TraversalQuery query = asked.traversal;
    query.waiting_lists = budget.waiting;
    std::optional<ChunkCache> others;
    if (asked.values != nullptr) {
        others.emplace(*asked.values, budget.values_cache);
        query.attribute_values = &*others;
    }
    std::optional<LabelView> label;
    if (asked.label) {
        label.emplace(store, asked.label->id, asked.label->within->first,
                      asked.label->within->second);
    }
    const ChunkSource& source = label ? static_cast<const ChunkSource&>(*label) : store;
    ChunkCache cache(source, budget.cache,
                     query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
    if (team != nullptr) {
        query.share = share_of(team->ranks, source, query, isovalues_of(found));
    }
    const auto start = Clock::now();
    std::vector<PartSink> sinks;
    for (const FoundParts& f : found) {
        sinks.emplace_back([parts = f.parts](std::uint64_t order, const MeshPart& part) {
            parts->append(order, part);
        });
    }
    const std::vector<TraversalCounts> counts = all_counts(
        {store, asked, query, cache, budget.part_vertices, scratch, progress}, found, sinks);
    if (team != nullptr) {
        ++team->work.traversals;
        team->work.traversal_seconds += elapsed_since(start);
        team->work.chunks_read += cache.chunks_read();
        team->work.bytes_read += cache.bytes_read();
    }
    for (std::size_t i = 0; i < found.size(); ++i) {
        Traversed traversed{counts[i], cache.chunks_read(), cache.bytes_read(), cache.peak_bytes()};
        if (team != nullptr) {
            team->work.leaves += counts[i].leaves;
            traversed = of_all(team->ranks, traversed);
            const auto before = Clock::now();
            const SettledParts settled =
                settle_parts(team->ranks, *found[i].parts, found[i].may_stay);
            found[i].stay = settled.stay;
            team->work.parts_bytes += settled.bytes;
            team->work.gathering_seconds += elapsed_since(before);
        } else {
            found[i].parts->seal();
        }
        report_errors(asked, traversed.counts, *found[i].report);
        TraversalReport& traversal = found[i].report->traversal;
        traversal.visited = traversed.counts.visited;
        traversal.leaves = traversed.counts.leaves;
        traversal.bricks = traversed.counts.bricks;
        traversal.peak_cache_bytes = traversed.peak_cache_bytes;
        traversal.chunks_read = traversed.chunks_read;
        traversal.bytes_read = traversed.bytes_read;
    }
}

}  // namespace isonest::detail
