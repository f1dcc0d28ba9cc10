#include "query/extract/extract_shared.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
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

#include "query/extract/extraction.h"
#include "query/mesh/mesh_sinks.h"
#include "query/ranks/mesh_on_ranks.h"
#include "query/ranks/rank_mapping.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest {

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

/// The next job from rank 0; empty if it is done. While a rank waits for it, it does not end the
/// run when all are requested to stop: rank 0 may be publishing a mesh.
std::string next_job(Communicator& ranks) {
    ranks.ignore_stop(true);
    std::string job = ranks.broadcast({});
    ranks.ignore_stop(job.empty());
    return job;
}

/// A rank other than rank 0.
class Helper {
  public:
    /// `values`: see extract_on_ranks(). All must outlive it.
    Helper(RankTeam& team, const Store& store, const Store* values, MemoryShare memory,
           const std::filesystem::path& folder, Progress& progress)
        : team_(team),
          store_(store.reader()),
          values_(values),
          memory_(std::move(memory)),
          folder_(folder),
          progress_(progress) {}

    void help_until_done() {
        for (std::string text = next_job(team_.ranks); !text.empty();
             text = next_job(team_.ranks)) {
            if (text.size() == kMeshToMake.size() + sizeof(std::size_t) &&
                text.starts_with(kMeshToMake)) {
                make_mesh(text);
            } else if (text == kBlocksToMap) {
                serve_blocks(team_, memory_, progress_);
            } else {
                traverse(text);
            }
        }
    }

  private:
    void make_mesh(std::string_view text) {
        std::size_t i = 0;
        std::memcpy(&i, text.data() + kMeshToMake.size(), sizeof(i));
        Workers(threads_).execute([&] { help_with_mesh(team_, parts_[i], *scratch_, progress_); });
    }
    /// Its share of one traversal of rank 0.
    void traverse(std::string_view text) {
        std::array<std::byte, sizeof(TraversalJob)> bytes{};
        std::memcpy(bytes.data(), text.data(), bytes.size());
        const auto job = std::bit_cast<TraversalJob>(bytes);
        std::vector<double> isovalues((text.size() - sizeof(job)) / sizeof(double));
        std::memcpy(isovalues.data(), text.data() + sizeof(job), isovalues.size() * sizeof(double));
        if (job.store != StoreMark(store_)) {
            throw Error(ErrorKind::invalid_argument, {store_.path().string()},
                        fmt::format("on {}, this name refers to a different store than on rank 0; "
                                    "all ranks must see the same file",
                                    team_.ranks.host()));
        }
        ExtractQuery asked = query_of(job, store_, values_);
        asked.traversal.iso = isovalues.front();
        parts_.clear();
        scratch_.emplace(ScratchFolder::metered(folder_));
        const PartsTraversal traversal(store_, asked, memory_, isovalues.size());
        const TraversalBudget& budget = traversal.budget();
        threads_ = budget.threads;
        std::vector<PartsPlace> places;
        for (const double iso : isovalues) {
            PartStore& parts = parts_.emplace_back(*scratch_, asked.steps, asked.origin,
                                                   budget.parts / isovalues.size(),
                                                   asked.traversal.attributes.width());
            asked.watch(parts);
            places.push_back({iso, &parts});
        }
        std::vector<FoundParts> found;
        Workers(threads_).execute(
            [&] { found = traversal.find(places, *scratch_, progress_, &team_); });
        if (std::none_of(found.begin(), found.end(), [](const FoundParts& f) { return f.stay; })) {
            parts_.clear();
        }
    }

    RankTeam& team_;
    const StoreReader& store_;
    const Store* values_;
    MemoryShare memory_;
    const std::filesystem::path& folder_;
    Progress& progress_;
    // Results of the last traversal.
    std::optional<ScratchFolder> scratch_;
    int threads_ = 1;
    std::deque<PartStore> parts_;  ///< for each isovalue
};

}  // namespace

void begin_shared_traversal(RankTeam& team, const StoreReader& store, const ExtractQuery& asked,
                            std::span<const double> isovalues) {
    const TraversalQuery& t = asked.traversal;
    TraversalJob job{StoreMark(store),
                     asked.product,
                     t.plane,
                     t.tolerance,
                     sent_field(store, t.stop),
                     t.bound,
                     t.culling,
                     t.vertices,
                     t.cells,
                     t.attributes,
                     t.box,
                     asked.values != nullptr,
                     asked.label.has_value(),
                     0,
                     {},
                     asked.steps,
                     asked.origin,
                     asked.coordinate_rounding,
                     asked.min_apart};
    // An address in this process.
    job.steps.uneven = nullptr;
    job.tolerance.use_axes(nullptr);
    if (t.attributes.error) {
        job.attributes.error = sent_field(store, *t.attributes.error);
    }
    if (asked.label) {
        job.label = asked.label->id;
        job.label_within = {asked.label->within->first, asked.label->within->second};
    }
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
        Helper(team, store, values, memory_of(options, store.path().string()), options.scratch,
               progress)
            .help_until_done();
    }
    return team.work;
}

}  // namespace isonest::detail
