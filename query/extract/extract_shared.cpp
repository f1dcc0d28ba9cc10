#include "query/extract/extract_shared.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/joined_isovalues.h>

#include "query/extract/extract.h"
#include "query/extract/extraction.h"
#include "query/mesh/mesh_sinks.h"
#include "query/ranks/mesh_on_ranks.h"
#include "query/ranks/rank_mapping.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest {
namespace {

void require_isovalues(const Store& store, std::span<const double> isovalues) {
    const std::string name = store.reader().path().string();
    if (isovalues.empty()) {
        throw Error(ErrorKind::invalid_argument, {name}, "no isovalues are given");
    }
    if (isovalues.size() > kMaxIsovalues) {
        throw Error(
            ErrorKind::limit, {name},
            fmt::format("{} isovalues; give at most {} per run", isovalues.size(), kMaxIsovalues));
    }
    std::vector<double> sorted(isovalues.begin(), isovalues.end());
    std::sort(sorted.begin(), sorted.end());
    if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
        twice != sorted.end()) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("the isovalue {} is given twice", *twice));
    }
}

/// Whether one traversal gives all of them: no search for an error, no kept analysis or interval of
/// the volume for each, and no rotated mesh.
bool are_together(const Store& store, const SurfaceQuery& query) {
    return !std::holds_alternative<TriangleBudgetByError>(query.stop) && !query.analysis &&
           !query.volume_interval && store.reader().layout().header().direction == kAlongWorld;
}

}  // namespace

void extract_isovalues(const Store& store, std::span<const double> isovalues,
                       const SurfaceQuery& query,
                       const std::function<std::unique_ptr<MeshSink>(std::size_t number)>& sink,
                       const std::function<void(std::size_t number, const ExtractReport&)>& done,
                       const ExtractOptions& options, Progress& progress) {
    require_isovalues(store, isovalues);
    SurfaceQuery own = query;
    if (!are_together(store, query)) {
        for (std::size_t i = 0; i < isovalues.size(); ++i) {
            own.iso = isovalues[i];
            const std::unique_ptr<MeshSink> to = sink(i);
            done(i, extract(store, own, *to, options, progress));
        }
        return;
    }
    std::unique_ptr<MeshSink> first = sink(0);
    detail::ExtractQuery asked;
    for (const double iso : isovalues) {
        own.iso = iso;
        asked = detail::extract_query(store.reader(), own, first->holds_float64());
    }
    detail::run_extractions(
        store.reader(), asked, isovalues,
        [&](std::size_t i) { return i == 0 ? std::move(first) : sink(i); }, done, options,
        progress);
}

void extract_joined(const Store& store, std::span<const double> isovalues,
                    const SurfaceQuery& query, MeshSink& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options, Progress& progress) {
    detail::JoinedMeshes joined(sink, isovalues, detail::ScratchFolder::metered(options.scratch));
    extract_isovalues(
        store, isovalues, query, [&](std::size_t i) { return joined.part(i); }, done, options,
        progress);
    joined.emit(progress);
}

}  // namespace isonest

namespace isonest::detail {
namespace {

/// Identifies the store, to verify that all ranks see the same one.
struct StoreMark {
    Int3 nodes;
    std::int64_t chunk = 0;
    std::uint64_t rows = 0;
    double low = 0;
    double high = 0;

    explicit StoreMark(const StoreReader& store)
        : nodes(store.layout().header().nodes),
          chunk(store.layout().header().chunk),
          rows(store.layout().rows()),
          low(store.min_value()),
          high(store.max_value()) {}
    bool operator==(const StoreMark&) const = default;
};

/// An own indicator in messages: its place among the fields of the store, because processes number
/// them differently (<isonest/field.h>). A store of one level may lack it; it needs none.
Field sent_field(const StoreReader& store, Field field) {
    const std::vector<Field>& fields = store.layout().header().fields;
    const auto found = std::find(fields.begin(), fields.end(), field);
    return !is_own(field)          ? field
           : found == fields.end() ? Field::deviation_bar
                                   : static_cast<Field>(kFieldCount + (found - fields.begin()));
}

Field received_field(const StoreReader& store, Field field) {
    return is_own(field) ? store.layout().header().fields.at(static_cast<std::size_t>(field) -
                                                             static_cast<std::size_t>(kFieldCount))
                         : field;
}

/// The part of a query that determines its parts; followed by the isovalues in a message.
struct TraversalJob {
    StoreMark store;
    Product product;
    std::optional<LatticePlane> plane;
    Tolerance tolerance;
    Field stop;
    Field bound;
    std::optional<Culling> culling;
    VertexPlace vertices;
    Cells cells;
    AttributeChoice attributes;
    ClipBox box;
    bool has_other_values;
    bool is_of_label;
    std::int64_t label;
    std::array<Int3, 2> label_within;
    LatticeSteps steps;
    Double3 origin;
    double coordinate_rounding;
    double min_apart;
};
static_assert(std::is_trivially_copyable_v<TraversalJob>);

TraversalJob job_of(const StoreReader& store, const ExtractQuery& q) {
    const TraversalQuery& t = q.traversal;
    TraversalJob job{
        StoreMark(store),    q.product,  t.plane, t.tolerance,  t.stop,   t.bound,
        t.culling,           t.vertices, t.cells, t.attributes, t.box,    q.values != nullptr,
        q.label.has_value(), 0,          {},      q.steps,      q.origin, q.coordinate_rounding,
        q.min_apart};
    job.stop = sent_field(store, t.stop);
    // An address in this process.
    job.steps.uneven = nullptr;
    job.tolerance.use_axes(nullptr);
    if (t.attributes.error) {
        job.attributes.error = sent_field(store, *t.attributes.error);
    }
    if (q.label) {
        job.label = q.label->id;
        job.label_within = {q.label->within->first, q.label->within->second};
    }
    return job;
}

ExtractQuery query_of(const TraversalJob& job, const StoreReader& store, const Store* values) {
    ExtractQuery q;
    q.product = job.product;
    TraversalQuery& t = q.traversal;
    t.plane = job.plane;
    t.tolerance = job.tolerance;
    t.stop = received_field(store, job.stop);
    t.bound = job.bound;
    t.culling = job.culling;
    t.vertices = job.vertices;
    t.cells = job.cells;
    t.attributes = job.attributes;
    if (t.attributes.error) {
        t.attributes.error = received_field(store, *t.attributes.error);
    }
    t.box = job.box;
    q.values = job.has_other_values ? &values->reader() : nullptr;
    if (job.is_of_label) {
        q.label = LabelChoice{job.label, {{job.label_within[0], job.label_within[1]}}};
    }
    q.steps = job.steps;
    q.steps.uneven = store.layout().header().uneven.get();
    t.tolerance.use_axes(q.steps.uneven);
    q.origin = job.origin;
    q.coordinate_rounding = job.coordinate_rounding;
    q.min_apart = job.min_apart;
    return q;
}

/// Sent instead of a TraversalJob, followed by the number of the mesh.
constexpr std::string_view kMeshToMake = "mesh";

/// A rank's results of the last traversal.
struct OwnShare {
    std::optional<ScratchFolder> scratch;
    int threads = 1;
    std::deque<PartStore> parts;  ///< for each isovalue
};

/// A rank's share of one traversal of rank 0.
void help(RankTeam& team, const StoreReader& store, const ExtractQuery& asked,
          std::span<const double> isovalues, const MemoryShare& memory,
          const std::filesystem::path& folder, Progress& progress, OwnShare& own) {
    own.parts.clear();
    const ScratchFolder& scratch = own.scratch.emplace(ScratchFolder::metered(folder));
    const TraversalBudget budget = parts_budget(store, asked, memory, isovalues.size());
    own.threads = budget.threads;
    std::vector<PartsPlace> places;
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
        PartStore& parts = own.parts.emplace_back(scratch, asked.steps, asked.origin,
                                                  budget.parts / isovalues.size(),
                                                  asked.traversal.attributes.width());
        watch_vertices(asked, parts);
        places.push_back({isovalues[i], &parts});
    }
    std::vector<FoundParts> found;
    Workers(budget.threads).execute([&] {
        found = find_parts(store, asked, budget, places, scratch, progress, &team);
    });
    if (std::none_of(found.begin(), found.end(), [](const FoundParts& f) { return f.stay; })) {
        own.parts.clear();
    }
}

void help_with_mesh_number(RankTeam& team, std::string_view text, OwnShare& own,
                           Progress& progress) {
    std::size_t i = 0;
    std::memcpy(&i, text.data() + kMeshToMake.size(), sizeof(i));
    Workers(own.threads).execute([&] {
        help_with_mesh(team, own.parts[i], *own.scratch, progress);
    });
}

/// The next job from rank 0; empty if it is done. While a rank waits for it, it does not end the
/// run when all are requested to stop: rank 0 may be publishing a mesh.
std::string next_job(Communicator& ranks) {
    ranks.ignore_stop(true);
    std::string job = ranks.broadcast({});
    ranks.ignore_stop(job.empty());
    return job;
}

void help_until_done(RankTeam& team, const Store& store, const Store* values,
                     const MemoryShare& memory, const std::filesystem::path& folder,
                     Progress& progress) {
    OwnShare own;
    for (std::string text = next_job(team.ranks); !text.empty(); text = next_job(team.ranks)) {
        if (text.size() == kMeshToMake.size() + sizeof(std::size_t) &&
            text.starts_with(kMeshToMake)) {
            help_with_mesh_number(team, text, own, progress);
            continue;
        }
        if (text == kBlocksToMap) {
            serve_blocks(team, memory, progress);
            continue;
        }
        TraversalJob job = job_of(store.reader(), {});
        std::memcpy(&job, text.data(), sizeof(job));
        std::vector<double> isovalues((text.size() - sizeof(job)) / sizeof(double));
        std::memcpy(isovalues.data(), text.data() + sizeof(job), isovalues.size() * sizeof(double));
        if (job.store != StoreMark(store.reader())) {
            throw Error(ErrorKind::invalid_argument, {store.path().string()},
                        fmt::format("on {}, this name refers to a different store than on rank 0; "
                                    "all ranks must see the same file",
                                    team.ranks.host()));
        }
        ExtractQuery asked = query_of(job, store.reader(), values);
        asked.traversal.iso = isovalues.front();
        help(team, store.reader(), asked, isovalues, memory, folder, progress, own);
    }
}

}  // namespace

bool is_shared(const ExtractQuery& asked) {
    return !asked.nested_distance &&
           (asked.product == Product::surface || asked.product == Product::slice ||
            asked.product == Product::contours);
}

void begin_shared_traversal(RankTeam& team, const StoreReader& store, const ExtractQuery& asked,
                            std::span<const double> isovalues) {
    const TraversalJob job = job_of(store, asked);
    std::string text(sizeof(job) + isovalues.size() * sizeof(double), '\0');
    std::memcpy(text.data(), &job, sizeof(job));
    std::memcpy(text.data() + sizeof(job), isovalues.data(), isovalues.size() * sizeof(double));
    team.ranks.broadcast(std::move(text));
}

void begin_shared_mesh(RankTeam& team, std::size_t i) {
    team.ranks.broadcast(std::string(kMeshToMake) +
                         std::string(reinterpret_cast<const char*>(&i), sizeof(i)));
}

RankWork extract_on_ranks(Communicator& ranks, const Store& store, const Store* values,
                          const std::function<void(const ExtractOptions&)>& work,
                          const ExtractOptions& options, Progress& progress) {
    RankTeam team{ranks};
    if (ranks.rank() == 0) {
        ExtractOptions own = options;
        own.team = &team;
        work(own);
        ranks.ignore_stop(true);  // all outputs have their final names
        ranks.broadcast({});
    } else {
        help_until_done(team, store, values, memory_of(options, store.path().string()),
                        options.scratch, progress);
    }
    return team.work;
}

}  // namespace isonest::detail
