#include "tools/view/store_answers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/labels.h>
#include <isonest/version.h>

#include "query/statistics/find_labels.h"
#include "query/values/label_view.h"
#include "query/values/node_fields.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "tools/cli/terminal/histogram_report.h"
#include "tools/cli/terminal/remedies.h"
#include "tools/view/mesh_message.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

/// Whether the command has this option.
bool has_option(const std::string& option) {
    return option == "--memory" || option == "--threads";
}

unsigned status_of(ErrorKind kind) {
    switch (kind) {
        case ErrorKind::invalid_argument:
        case ErrorKind::not_found:
        case ErrorKind::unsupported:
            return 400;
        case ErrorKind::limit:
            return 413;
        case ErrorKind::cancelled:
            return 409;
        case ErrorKind::corrupt:
        case ErrorKind::io:
            return 500;
    }
    return 500;
}

}  // namespace

HttpAnswer json_answer(const Json& json, unsigned status) {
    return {status,
            "application/json",
            json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n",
            {}};
}

HttpAnswer error_answer(const Error& error) {
    return json_answer({{"error", cli::json_of(error, has_option)}}, status_of(error.kind()));
}

HttpAnswer plain_error(unsigned status, const std::string& kind, const std::string& message) {
    return json_answer(
        {{"error", {{"kind", kind}, {"message", message}, {"remedies", Json::array()}}}}, status);
}

// The bound of a level covers everything below it. So its largest value, which is in the catalogue,
// is an error at which no element is refined beyond that level.

namespace {

/// Requests the ranges that a traversal of a remote store reads.
void want_ranges(const StoreReader& store) {
    const StoreLayout& layout = store.layout();
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        const auto cubes = static_cast<std::uint64_t>(layout.lattice().cells_at(level).product());
        if (cubes * cube_range_bytes(layout.header().type) <= CubeRangeTable::kMaxRemote) {
            store.prefetch_cube_ranges(level);
        }
    }
}

}  // namespace

std::optional<FirstLevels> fetch_first_levels(const StoreReader& store) {
    const StoreLayout& layout = store.layout();
    const std::optional<Field> bound = layout.tightest_bound();
    const bool are_labels = layout.header().labels || store.label_names().size() > 0;
    if (!store.is_remote() || store.catalogue() == nullptr || !bound || are_labels) {
        return std::nullopt;
    }
    std::optional<FirstLevels> first;
    std::vector<WantedChunk> chunks;
    std::uint64_t bytes = 0;
    for (int level = layout.lattice().top(); level >= 1; --level) {
        const ArrayInfo& values = layout.array(level, Field::values);
        const ArrayInfo& bounds = layout.array(level, *bound);
        const ArrayTotals of_bounds = store.totals(bounds);
        bytes += store.totals(values).bytes + of_bounds.bytes;
        if (bytes > FirstLevels::kMaxBytes) {
            break;
        }
        for (const ArrayInfo* const array : {&values, &bounds}) {
            for (std::int64_t i = 0; i < array->grid.product(); ++i) {
                chunks.push_back({array, array->grid.unlinear(i)});
            }
        }
        // Rounded up, so that at least the largest indicator is left of it for the levels.
        constexpr double kRoundedUp = 1 + 1e-12;
        const double tolerance = layout.header().rounding.tolerance;
        first = FirstLevels{
            level, tolerance > 0 ? (of_bounds.max + tolerance) * kRoundedUp : of_bounds.max};
    }
    if (first) {
        store.prefetch_all(chunks);
        want_ranges(store);
    }
    return first;
}

// The value at a point.

namespace {

/// Values of single nodes; caches the last chunk.
class Nodes {
  public:
    explicit Nodes(const StoreReader& store)
        : store_(&store), array_(&store.layout().array(0, Field::values)) {}

    double operator()(const Int3& node) {
        const Int3 chunk = array_->chunk_of(node);
        if (data_.empty() || !(chunk == chunk_)) {
            data_.resize(array_->chunk_bytes());
            store_->decode(*array_, chunk, data_);
            chunk_ = chunk;
        }
        const auto place =
            static_cast<std::size_t>(array_->chunk.linear(node - array_->first_node(chunk)));
        return dispatch(store_->layout().header().type, [&](auto tag) {
            typename decltype(tag)::type number{};
            std::memcpy(&number, data_.data() + place * sizeof number, sizeof number);
            return static_cast<double>(number);
        });
    }

  private:
    const StoreReader* store_;
    const ArrayInfo* array_;
    Int3 chunk_{};
    std::vector<std::byte> data_;
};

std::optional<double> finite(double value) {
    return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

/// `last`: the last node along each axis; `place`: from 0 to there.
double value_between(Nodes& nodes, const Int3& last, const Double3& place) {
    Int3 cell{};
    Double3 in_cell{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        cell[axis] = std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(place[a])), 0,
                                              std::max<std::int64_t>(last[axis] - 1, 0));
        in_cell[a] = place[a] - static_cast<double>(cell[axis]);
    }
    return linear_value(cell, in_cell, [&](const Int3& node) { return nodes(node); });
}

}  // namespace

PointValue value_at(const Store& store, const Double3& world, std::uint64_t memory) {
    const StoreReader& reader = store.reader();
    const ArrayInfo& array = reader.layout().array(0, Field::values);
    require_memory(store.path().string(), memory,
                   array.chunk_bytes() + decode_heap(array.chunk_bytes()), "this store's chunks");
    const StoreHeader& header = reader.layout().header();
    const Double3& origin = header.origin;
    const Double3 steps = header.steps().steps_of(unrotated(
        header.rotation(), {world[0] - origin[0], world[1] - origin[1], world[2] - origin[2]}));
    const Int3 last = store.nodes() - Int3{1, 1, 1};
    PointValue result;
    result.inside = true;
    Double3 place{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // A point on a face of the volume is inside, despite rounding.
        constexpr double kRounding = 1e-6;
        const auto end = static_cast<double>(last[static_cast<int>(axis)]);
        const double at = steps[axis];
        result.inside = result.inside && at >= -kRounding && at <= end + kRounding;
        // NaN from infinity times 0: outside.
        place[axis] = std::isnan(at) ? 0 : std::clamp(at, 0.0, end);
        result.node[static_cast<int>(axis)] = std::llround(place[axis]);
    }
    if (!result.inside) {
        return result;
    }
    // Requests all chunks that may be read in one round trip.
    std::vector<WantedChunk> wanted;
    const Int3 low{static_cast<std::int64_t>(place[0]), static_cast<std::int64_t>(place[1]),
                   static_cast<std::int64_t>(place[2])};
    want_box(array, low, low + Int3{1, 1, 1}, wanted);
    if (reader.is_remote()) {
        reader.prefetch_all(wanted);
    }
    Nodes nodes(reader);
    result.value = finite(value_between(nodes, last, place));
    result.node_value = finite(nodes(result.node));
    return result;
}

namespace {

/// The name and colour of a label.
Json label_json(const Store& store, std::int64_t id) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    return {{"id", id},
            {"name", label.name.empty() ? Json() : Json(label.name)},
            {"color", label.color ? Json(*label.color) : Json()}};
}

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json();
}

/// A value of the store; a label if the store has labels.
Json value_json(const StoreReader& store, double value) {
    const auto label = wide_label(store.layout().header(), value);
    return label ? Json(*label) : number(value);
}

Json array_of(const Int3& v) {
    return Json{v.x, v.y, v.z};
}

/// The smallest box along the world's axes that contains the volume.
std::array<double, 6> world_box(const Store& store) {
    const Double3 spacing = store.spacing();
    const Double3 origin = store.origin();
    const Directions axes = store.direction();
    std::array<double, 6> box{};
    for (std::size_t k = 0; k < 3; ++k) {
        box[k] = box[k + 3] = origin[k];
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double reach = axes[axis][k] * spacing[axis] *
                                 static_cast<double>(store.nodes()[static_cast<int>(axis)] - 1);
            box[reach < 0 ? k : k + 3] += reach;
        }
    }
    return box;
}

}  // namespace

double range_of(const Store& store) {
    return std::max(store.max_value() - store.min_value(), 0.0);
}

MemoryShares::MemoryShares(std::uint64_t memory_)
    : memory(memory_),
      surface(memory / 16 * 3),
      surface_message(memory / 4),
      slice(memory / 8),
      slice_message(memory / 16),
      file(memory / 16 * kFileParts),
      small(memory / 16),
      sending(memory / 8) {}

std::uint64_t MemoryShares::for_files(std::uint64_t bytes) {
    return (bytes + kFileParts - 1) / kFileParts * 16;
}

MemoryShares MemoryShares::of_page(std::uint64_t memory) {
    MemoryShares shares(memory);
    shares.surface = shares.slice = shares.file = shares.small = memory / 16 * 6;
    shares.surface_message = shares.slice_message = memory / 16 * 3;
    return shares;
}

StoreAnswers::StoreAnswers(const Store& store, const MemoryShares& shares, int threads,
                           std::vector<Quantity> quantities)
    : store_(store),
      shares_(shares),
      threads_(threads),
      quantities_(std::move(quantities)),
      first_(fetch_first_levels(store.reader())) {
    require_even_axes(store.reader().layout().header(), store.path().string(), "the viewer");
}

bool StoreAnswers::are_labels() const {
    return store_.reader().layout().header().labels || store_.reader().label_names().size() > 0;
}

HttpAnswer StoreAnswers::label(RequestTarget& target) const {
    const auto id = target.integer("id", std::numeric_limits<std::int64_t>::min(),
                                   std::numeric_limits<std::int64_t>::max());
    target.require_all_taken();
    if (!id) {
        throw Error(ErrorKind::invalid_argument, "id is missing: a label");
    }
    return json_answer(label_json(store_, *id));
}

bool StoreAnswers::take_labels(RequestTarget& target) {
    const bool named = target.integer("named", 0, 1).value_or(0) == 1;
    target.require_all_taken();
    return named;
}

HttpAnswer StoreAnswers::labels(bool named, Progress& progress) const {
    std::map<std::int64_t, Json> all;
    for (const LabelName& label : store_.label_names()) {
        all[label.id] = label_json(store_, label.id);
        all[label.id]["nodes"] = nullptr;
    }
    if (!named) {
        LabelOptions options;
        options.memory = shares_.small;
        options.threads = threads_;
        for (auto& [id, label] : all) {
            label["nodes"] = 0;
        }
        for (const Label& label : find_labels(store_, options, progress)) {
            Json& json = all[label.id];
            if (json.is_null()) {
                json = label_json(store_, label.id);
            }
            json["nodes"] = label.nodes;
        }
    }
    Json list = Json::array();
    for (auto& [id, label] : all) {
        list.push_back(std::move(label));
    }
    return json_answer({{"labels", std::move(list)}});
}

HistogramOptions StoreAnswers::take_histogram(RequestTarget& target) const {
    const bool coarse = target.integer("coarse", 0, 1).value_or(0) == 1;
    target.require_all_taken();
    HistogramOptions options;
    options.memory = shares_.small;
    options.threads = threads_;
    if (coarse && first_) {
        options.level = first_->level;
        options.own_cubes = true;
    }
    return options;
}

HttpAnswer StoreAnswers::histogram(const HistogramOptions& options, Progress& progress) const {
    return json_answer(cli::histogram_json(detail::histogram(store_.reader(), options, progress)));
}

Double3 StoreAnswers::take_place(RequestTarget& target) {
    const auto at = target.numbers("at", 3, "x,y,z");
    target.require_all_taken();
    if (!at) {
        throw Error(ErrorKind::invalid_argument, "at is missing: x,y,z");
    }
    return {(*at)[0], (*at)[1], (*at)[2]};
}

HttpAnswer StoreAnswers::value(const Double3& place) const {
    const PointValue found = value_at(store_, place, shares_.small);
    const auto value = [](const std::optional<double>& v) { return v ? Json(*v) : Json(); };
    Json json = {{"world", place},
                 {"node", array_of(found.node)},
                 {"inside", found.inside},
                 {"value", value(found.value)},
                 {"node_value", value(found.node_value)}};
    if (are_labels()) {
        for (const char* const name : {"value", "node_value", "label", "name"}) {
            json[name] = nullptr;
        }
        if (found.node_value) {
            const bool coded = store_.reader().layout().header().labels;
            if (const auto id = label_of(*found.node_value, coded)) {
                json["node_value"] = *id;
                json["label"] = std::to_string(*id);
                json["name"] = label_json(store_, *id)["name"];
            }
        }
    }
    if (!quantities_.empty()) {
        Json& all = json["quantities"] = Json::object();
        for (const Quantity& quantity : quantities_) {
            all[quantity.name] = value(value_at(*quantity.store, place, shares_.small).value);
        }
    }
    return json_answer(json);
}

MeshRequest StoreAnswers::take_mesh(RequestTarget& target, const std::string& path) const {
    const bool is_slice = path == "/api/slice" || (path != "/api/surface" && target.has("plane"));
    MeshRequest request = parse_mesh_request(target, is_slice, are_labels());
    target.require_all_taken();
    if (request.color.empty()) {
        return request;
    }
    const auto found = std::find_if(quantities_.begin(), quantities_.end(),
                                    [&](const Quantity& q) { return q.name == request.color; });
    if (found == quantities_.end()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("color '{}': there is no such quantity; isonest view "
                                "--vertex-values NAME=STORE adds one",
                                request.color));
    }
    request.color_store = found->store;
    return request;
}

HttpAnswer StoreAnswers::describe(const SeriesSummary* series) const {
    const StoreReader& reader = store_.reader();
    const double min = series != nullptr ? series->min_value : reader.min_value();
    const double max = series != nullptr ? series->max_value : reader.max_value();
    const bool any = min <= max;
    const Int3 nodes = store_.nodes();
    const int dimension = int{nodes.x > 1} + int{nodes.y > 1} + int{nodes.z > 1};
    const bool integer = store_.type() != ValueType::f32 && store_.type() != ValueType::f64;
    Json json = {
        {"name", series != nullptr ? series->name : store_.path().filename().string()},
        {"nodes", array_of(nodes)},
        {"type", type_of_values(reader.layout().header())},
        {"spacing", store_.spacing()},
        {"origin", store_.origin()},
        {"direction", store_.direction()},
        {"unit", store_.unit() ? Json(symbol_of(*store_.unit())) : Json()},
        {"frame",
         store_.frame() == AnatomicalFrame::unknown ? Json() : Json(name_of(store_.frame()))},
        {"box", world_box(store_)},
        {"min_value", any ? value_json(reader, min) : Json()},
        {"max_value", any ? value_json(reader, max) : Json()},
        {"integer", integer},
        {"has_missing", series != nullptr ? series->has_missing : store_.has_missing()},
        {"levels", store_.levels()},
        {"labels", are_labels()},
        {"remote", store_.is_remote()},
        {"dimension", dimension},
        {"file_bytes", series != nullptr ? series->file_bytes : reader.file_bytes()},
        {"largest_error", 2 * (series != nullptr ? series->range : range_of(store_))},
        {"tolerance", series != nullptr ? series->tolerance : store_.rounding().tolerance},
        {"first_error", first_ ? number(first_->error) : Json()},
        {"most_triangles", shares_.surface_message / MeshMessage::kTriangleHeap},
        {"memory", shares_.memory},
        {"version", ISONEST_VERSION},
        {"series", nullptr},
        {"quantities", Json::array()}};
    for (const Quantity& quantity : quantities_) {
        const bool has_values = quantity.store->min_value() <= quantity.store->max_value();
        json["quantities"].push_back(
            {{"name", quantity.name},
             {"min_value", has_values ? Json(quantity.store->min_value()) : Json()},
             {"max_value", has_values ? Json(quantity.store->max_value()) : Json()}});
    }
    if (series != nullptr) {
        json["series"] = {{"time_unit", series->time_unit ? Json(*series->time_unit) : Json()},
                          {"times", series->times}};
    }
    return json_answer(json);
}

}  // namespace isonest::detail::view
