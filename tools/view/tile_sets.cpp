#include "tools/view/tile_sets.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <span>
#include <string_view>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_sink.h>
#include <isonest/tileset.h>

#include "query/tiles/coarser_tile.h"
#include "query/tiles/tileset_maker.h"
#include "store/base/memory.h"
#include "store/container/reader.h"
#include "tools/cli/options/tile_output.h"
#include "tools/view/http_server.h"
#include "tools/view/store_answers.h"

namespace isonest::detail::view {

void PackedTileset::write(const std::string& path, const std::string& bytes) {
    std::uint64_t at = 0;
    {
        const std::lock_guard lock(mutex_);
        at = end_;
        end_ += bytes.size();
        places_.emplace(path, std::pair{at, std::uint64_t{bytes.size()}});
    }
    file_.write_at(at, std::as_bytes(std::span(bytes)));
}

std::optional<std::string> PackedTileset::read(const std::string& path) const {
    std::pair<std::uint64_t, std::uint64_t> place;
    {
        const std::lock_guard lock(mutex_);
        const auto found = places_.find(path);
        if (found == places_.end()) {
            return std::nullopt;
        }
        place = found->second;
    }
    std::string bytes(place.second, '\0');
    file_.read_at(place.first, std::as_writable_bytes(std::span(bytes)));
    return bytes;
}

std::uint64_t PackedTileset::bytes() const {
    const std::lock_guard lock(mutex_);
    return end_;
}

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxKept = 4;
/// Browsers ask only once a minute for a page in the background.
constexpr auto kAbandoned = std::chrono::minutes(3);
constexpr std::int64_t kMinLimit = 100;
constexpr std::int64_t kMaxLimit = 100'000'000;
constexpr std::string_view kFiles = "/api/tileset/";

struct FewTriangles : public std::exception {
    explicit FewTriangles(std::uint64_t triangles_) : triangles(triangles_) {}
    [[nodiscard]] const char* what() const noexcept override { return "few triangles"; }
    std::uint64_t triangles;
};

/// Passes on a mesh of more than `limit` triangles, in world units and as stored.
class LargeMeshSink : public MeshSink {
  public:
    LargeMeshSink(MeshSink& to, std::uint64_t limit) : to_(to), limit_(limit) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        to_.prepare(as_stored(layout), inputs);
    }
    /// Throws FewTriangles.
    void begin(const MeshLayout& layout) override {
        if (layout.elements <= limit_) {
            throw FewTriangles(layout.elements);
        }
        triangles_ = layout.elements;
        to_.begin(as_stored(layout));
    }
    void add_vertices(const VertexBatch& batch) override { to_.add_vertices(batch); }
    void add_elements(const ElementBatch& batch) override { to_.add_elements(batch); }
    [[nodiscard]] bool again() override { return to_.again(); }
    void end() override { to_.end(); }
    [[nodiscard]] bool concurrent() const override { return to_.concurrent(); }
    [[nodiscard]] bool holds_float64() const override { return to_.holds_float64(); }
    [[nodiscard]] std::uint64_t triangles() const { return triangles_; }

  private:
    static MeshLayout as_stored(MeshLayout layout) {
        layout.unit.reset();
        layout.frame = AnatomicalFrame::unknown;
        return layout;
    }
    MeshSink& to_;
    std::uint64_t limit_;
    std::uint64_t triangles_ = 0;
};

/// Heap for one thread that makes tiles.
std::uint64_t least_memory() {
    return 2 * kLibraryHeap + coarser_tile_heap();
}

/// For a large mesh without the memory for its tiles.
class NoMemorySink : public MeshSink {
  public:
    explicit NoMemorySink(std::filesystem::path store) : store_(std::move(store)) {}
    /// Throws Error{limit}.
    void begin(const MeshLayout& /*layout*/) override {
        throw Error(ErrorKind::limit, {store_.string()},
                    "there is too little memory for tiles of this surface",
                    {{RemedyKind::more_memory,
                      fmt::format("{}", MemoryShares::for_files(least_memory()))}});
    }
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& /*batch*/) override {}

  private:
    std::filesystem::path store_;
};

}  // namespace

/// Tiles in the making.
class TileSets::TileJob : public Job {
  public:
    void begin(std::string_view phase, std::uint64_t total, std::string_view /*unit*/) override {
        const std::lock_guard lock(mutex_);
        phase_ = phase;
        total_ = total;
        done_ = 0;
    }
    void advance(std::uint64_t amount) override { done_ += amount; }
    /// Also if nobody has asked for long; asking later does not change that.
    [[nodiscard]] bool cancelled() const override {
        if (Clock::now() - asked_.load() > kAbandoned) {
            is_abandoned_ = true;
        }
        return is_abandoned_ || Job::cancelled();
    }
    void asked() { asked_ = Clock::now(); }
    /// The phase, and which part of it is done.
    [[nodiscard]] std::pair<std::string, double> progress() const {
        const std::lock_guard lock(mutex_);
        const double part =
            total_ > 0 ? static_cast<double>(done_) / static_cast<double>(total_) : 0;
        return {phase_, std::min(part, 1.0)};
    }

  private:
    mutable std::mutex mutex_;
    std::string phase_;
    std::uint64_t total_ = 0;
    std::atomic<std::uint64_t> done_ = 0;
    std::atomic<Clock::time_point> asked_ = Clock::now();
    mutable std::atomic<bool> is_abandoned_ = false;
};

struct TileSets::Set {
    enum class State : std::uint8_t { making, ready, unneeded, failed };

    Set(std::size_t step_, double iso_, std::uint64_t limit_)
        : step(step_), iso(iso_), limit(limit_), files(ScratchFolder(temporary_folder())) {}

    const std::size_t step;
    const double iso;
    const std::uint64_t limit;
    const std::string id = new_token();
    PackedTileset files;
    std::shared_ptr<TileJob> job = std::make_shared<TileJob>();
    // With the mutex of TileSets locked; set once, when the work ends.
    State state = State::making;
    std::uint64_t triangles = 0;  ///< of the full surface
    double data_tolerance = 0;
    std::vector<TileLevel> levels;
    HttpAnswer failure;
};

TileSets::SetPointer TileSets::find(std::size_t step, double iso) const {
    const auto found = std::find_if(sets_.begin(), sets_.end(), [&](const SetPointer& set) {
        const bool is_ending = set->state == Set::State::making && set->job->cancelled();
        return set->step == step && set->iso == iso && !is_ending;
    });
    return found == sets_.end() ? nullptr : *found;
}

/// A job in progress is cancelled.
void TileSets::forget(const SetPointer& set) {
    set->job->cancel();
    sets_.remove(set);
}

void TileSets::leave(const std::string& stream) {
    const auto found = wanted_by_.find(stream);
    if (found == wanted_by_.end()) {
        return;
    }
    const SetPointer set = found->second;
    wanted_by_.erase(found);
    const bool is_wanted = std::any_of(wanted_by_.begin(), wanted_by_.end(),
                                       [&](const auto& entry) { return entry.second == set; });
    if (set->state == Set::State::making && !is_wanted) {
        forget(set);
    }
}

void TileSets::drop_oldest() {
    // Not those in the making: pages wait for them, and the lane limits their number.
    auto kept = static_cast<std::size_t>(
        std::count_if(sets_.begin(), sets_.end(),
                      [](const SetPointer& set) { return set->state != Set::State::making; }));
    for (auto set = sets_.end(); kept > kMaxKept && set != sets_.begin();) {
        --set;
        if ((*set)->state != Set::State::making) {
            set = sets_.erase(set);
            --kept;
        }
    }
}

void TileSets::cancel(const std::string& stream) {
    const std::lock_guard lock(mutex_);
    leave(stream);
}

void TileSets::make_way() {
    const std::lock_guard lock(mutex_);
    const std::list<SetPointer> all = sets_;
    for (const SetPointer& set : all) {
        if (set->state == Set::State::making) {
            forget(set);
        }
    }
}

HttpAnswer TileSets::describe(const SetPointer& set, std::uint64_t limit) {
    using Json = nlohmann::ordered_json;
    switch (set->state) {
        case Set::State::making: {
            const auto [phase, part] = set->job->progress();
            return json_answer({{"state", phase.empty() ? "waiting" : "making"},
                                {"phase", phase.empty() ? Json() : Json(phase)},
                                {"part", part}});
        }
        case Set::State::ready:
            if (set->triangles > limit) {
                Json levels = Json::array();
                for (const TileLevel& level : set->levels) {
                    levels.push_back({{"distance_bound", level.bound},
                                      {"tiles", level.tiles},
                                      {"triangles", level.triangles}});
                }
                return json_answer({{"state", "ready"},
                                    {"tileset", set->id},
                                    {"triangles", set->triangles},
                                    {"data_tolerance", set->data_tolerance},
                                    {"bytes", set->files.bytes()},
                                    {"levels", levels}});
            }
            [[fallthrough]];
        case Set::State::unneeded:
            return json_answer({{"state", "unneeded"}, {"triangles", set->triangles}});
        case Set::State::failed:
            break;
    }
    HttpAnswer failure = std::move(set->failure);
    forget(set);
    return failure;
}

HttpAnswer TileSets::state(std::size_t step, RequestTarget& target, const std::string& stream,
                           WorkLane& lane) {
    constexpr double kAny = std::numeric_limits<double>::max();
    const std::optional<double> iso = target.number("iso", -kAny, kAny);
    const std::optional<std::int64_t> limit = target.integer("limit", kMinLimit, kMaxLimit);
    target.require_all_taken();
    if (!iso || !limit || stream.empty()) {
        fail("give iso, limit and stream");
    }
    const OpenStep& first = steps_.first();
    if (first.answers.are_labels() || first.store.nodes().z == 1) {
        fail("tiles are made of isosurfaces in space only");
    }
    if (first.store.is_remote()) {
        fail("no tiles are made of a store at a URL, because that needs all of its values");
    }
    const auto most = static_cast<std::uint64_t>(*limit);
    const std::lock_guard lock(mutex_);
    SetPointer set = find(step, *iso);
    if (set != nullptr && set->state == Set::State::unneeded && set->triangles > most) {
        forget(set);
        set = nullptr;
    }
    if (const auto before = wanted_by_.find(stream);
        before != wanted_by_.end() && before->second != set) {
        leave(stream);
    }
    if (set == nullptr) {
        set = std::make_shared<Set>(step, *iso, most);
        const bool taken =
            lane.add(set->job, [this, set](Job& job) { run(set, static_cast<TileJob&>(job)); });
        if (!taken) {
            return plain_error(503, "limit", "the server is busy: try again later");
        }
    } else {
        sets_.remove(set);
    }
    sets_.push_front(set);
    std::erase_if(wanted_by_,
                  [](const auto& entry) { return entry.second->state != Set::State::making; });
    if (set->state == Set::State::making) {
        wanted_by_[stream] = set;
    }
    set->job->asked();
    drop_oldest();
    return describe(set, most);
}

void TileSets::run(const SetPointer& set, TileJob& job) {
    HttpAnswer failure = guarded([&]() -> HttpAnswer {
        job.check();
        make(*set, job);
        return {};
    });
    const std::lock_guard lock(mutex_);
    if (set->state == Set::State::making) {
        set->state = Set::State::failed;
        set->failure = std::move(failure);
        if (job.cancelled()) {
            forget(set);  // and begun again if it is requested again
        }
    }
}

void TileSets::make(Set& set, TileJob& job) {
    const std::shared_ptr<const OpenStep> opened = steps_.open(set.step);
    const Store& store = opened->store;
    TilesetOptions options;
    cli::set_lattice(store.reader().layout().header(), std::nullopt, options);
    options.memory = memory_;
    options.threads = threads_;
    std::optional<TilesetMaker> maker;
    std::unique_ptr<MeshSink> tiles = std::make_unique<NoMemorySink>(store.path());
    if (memory_ >= least_memory()) {
        maker.emplace(store.path(), options,
                      [&set](const std::string& path, const std::string& bytes) {
                          set.files.write(path, bytes);
                      });
        tiles = maker->sink();
    }
    MeshRequest request;
    request.what = set.iso;
    LargeMeshSink large(*tiles, set.limit);
    ExtractOptions extraction;
    extraction.memory = memory_;
    extraction.threads = threads_;
    try {
        extract(store, surface_query(request, ErrorBound{0}), large, extraction, job);
    } catch (const FewTriangles& few) {
        const std::lock_guard lock(mutex_);
        set.triangles = few.triangles;
        set.state = Set::State::unneeded;
        return;
    }
    std::vector<TileLevel> levels = maker->finish({}, job);
    const std::lock_guard lock(mutex_);
    set.levels = std::move(levels);
    set.triangles = large.triangles();
    set.data_tolerance = store.rounding().tolerance;
    set.state = Set::State::ready;
}

HttpAnswer TileSets::file(const std::string& path) const {
    const std::string rest = path.substr(std::min(kFiles.size(), path.size()));
    const std::size_t slash = std::min(rest.find('/'), rest.size());
    SetPointer set;
    {
        const std::lock_guard lock(mutex_);
        const auto found = std::find_if(sets_.begin(), sets_.end(), [&](const SetPointer& one) {
            return one->id == rest.substr(0, slash) && one->state == Set::State::ready;
        });
        set = found == sets_.end() ? nullptr : *found;
    }
    const std::string name = rest.substr(std::min(slash + 1, rest.size()));
    std::optional<std::string> bytes = set ? set->files.read(name) : std::nullopt;
    if (!bytes) {
        return plain_error(404, "not_found", "there is no such tile, or no longer");
    }
    const bool is_list = name.ends_with(".json");
    return {200, is_list ? "application/json" : "model/gltf-binary", std::move(*bytes), {}};
}

}  // namespace isonest::detail::view
