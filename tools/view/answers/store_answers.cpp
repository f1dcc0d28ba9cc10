#include "tools/view/answers/store_answers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include <isonest/error.h>
#include <isonest/version.h>

#include "query/labels/label_of_value.h"
#include "query/view/label_view.h"
#include "store/container/reader.h"
#include "tools/cli/terminal/histogram_json.h"
#include "tools/view/answers/answers.h"
#include "tools/view/mesh_message.h"
#include "tools/view/point_value.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

/// What is known of a label.
Json label_json(const Store& store, std::int64_t id) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    return {{"id", id},
            {"name", label.name.empty() ? Json() : Json(label.name)},
            {"color", label.color ? Json(*label.color) : Json()}};
}

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json();
}

/// Of a value of the store; labels as such.
Json value_json(const StoreReader& store, double value) {
    const auto label = wide_label(store.layout().header(), value);
    return label ? Json(*label) : number(value);
}

Json array_of(const Int3& v) {
    return Json{v.x, v.y, v.z};
}

/// The smallest box along the world's axes that holds the volume.
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
      surface(memory / 4),
      surface_message(memory / 4),
      slice(memory / 8),
      slice_message(memory / 16),
      file(memory / 8),
      small(memory / 16),
      sending(memory / 8) {}

MemoryShares MemoryShares::of_page(std::uint64_t memory) {
    MemoryShares shares(memory);
    shares.surface = shares.slice = shares.file = shares.small = memory / 16 * 6;
    shares.surface_message = shares.slice_message = memory / 16 * 3;
    return shares;
}

StoreAnswers::StoreAnswers(const Store& store, const MemoryShares& shares, int threads)
    : store_(store),
      shares_(shares),
      threads_(threads),
      first_(fetch_first_levels(store.reader())) {}

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
    return json_answer(json);
}

MeshRequest StoreAnswers::take_mesh(RequestTarget& target, const std::string& path) const {
    const bool is_slice = path == "/api/slice" || (path != "/api/surface" && target.has("plane"));
    MeshRequest request = parse_mesh_request(target, is_slice, are_labels());
    target.require_all_taken();
    return request;
}

HttpAnswer StoreAnswers::describe() const {
    const bool any = store_.min_value() <= store_.max_value();
    const Int3 nodes = store_.nodes();
    const int dimension = int{nodes.x > 1} + int{nodes.y > 1} + int{nodes.z > 1};
    const bool integer = store_.type() != ValueType::f32 && store_.type() != ValueType::f64;
    Json json = {
        {"name", store_.path().filename().string()},
        {"nodes", array_of(nodes)},
        {"type", type_of_values(store_.reader().layout().header())},
        {"spacing", store_.spacing()},
        {"origin", store_.origin()},
        {"direction", store_.direction()},
        {"unit", store_.unit() ? Json(symbol_of(*store_.unit())) : Json()},
        {"frame",
         store_.frame() == AnatomicalFrame::unknown ? Json() : Json(name_of(store_.frame()))},
        {"box", world_box(store_)},
        {"min_value", any ? value_json(store_.reader(), store_.reader().min_value()) : Json()},
        {"max_value", any ? value_json(store_.reader(), store_.reader().max_value()) : Json()},
        {"integer", integer},
        {"has_missing", store_.has_missing()},
        {"levels", store_.levels()},
        {"labels", are_labels()},
        {"dimension", dimension},
        {"file_bytes", store_.reader().file_bytes()},
        {"largest_error", 2 * range_of(store_)},
        {"first_error", first_ ? number(first_->error) : Json()},
        {"most_triangles", shares_.surface_message / MeshMessage::kTriangleHeap},
        {"memory", shares_.memory},
        {"version", ISONEST_VERSION}};
    return json_answer(json);
}

}  // namespace isonest::detail::view
