#include "tools/view/view_service.h"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <new>
#include <nlohmann/json.hpp>
#include <utility>

#include <isonest/error.h>
#include <isonest/version.h>

#include "query/labels/label_of_value.h"
#include "query/statistics/histogram.h"
#include "store/container/reader.h"
#include "tools/cli/terminal/histogram_text.h"
#include "tools/cli/terminal/remedies.h"
#include "tools/view/mesh_message.h"
#include "tools/view/page_files.h"
#include "tools/view/point_value.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostWaiting = 16;

HttpAnswer json_answer(const Json& json, unsigned status = 200) {
    return {status,
            "application/json",
            json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n",
            {}};
}

/// The options that the command has.
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

HttpAnswer error_answer(const Error& error) {
    return json_answer({{"error", cli::json_of(error, has_option)}}, status_of(error.kind()));
}

HttpAnswer plain_error(unsigned status, const std::string& kind, const std::string& message) {
    return json_answer(
        {{"error", {{"kind", kind}, {"message", message}, {"remedies", Json::array()}}}}, status);
}

/// Runs the work; whatever it throws is an answer.
template <class Work>
HttpAnswer guarded(const Work& work) {
    try {
        return work();
    } catch (const Error& e) {
        return error_answer(e);
    } catch (const std::bad_alloc&) {
        return error_answer(Error(ErrorKind::limit, "out of memory", {{RemedyKind::less_memory}}));
    } catch (const std::exception& e) {
        return plain_error(500, "internal",
                           fmt::format("internal error, please report it: {}", e.what()));
    }
}

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

/// Of a file's name, letters and digits alone: it leads into no other folder and ends no header.
std::string take_ending(RequestTarget& target) {
    std::string ending = target.text("format").value_or("ply");
    if (!std::all_of(ending.begin(), ending.end(),
                     [](unsigned char c) { return std::isalnum(c) != 0; })) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("format '{}': give the ending of a mesh file, such as ply", ending));
    }
    return ending;
}

double range_of(const Store& store) {
    return std::max(store.max_value() - store.min_value(), 0.0);
}

}  // namespace

MemoryShares::MemoryShares(std::uint64_t memory_)
    : memory(memory_),
      surface(memory / 4),
      surface_message(memory / 4),
      slice(memory / 8),
      slice_message(memory / 16),
      file(memory / 8),
      small(memory / 16),
      sending(memory / 8) {}

ViewService::ViewService(const Store& store, const MemoryShares& shares, int threads, Access access,
                         std::function<std::size_t()> connections)
    : store_(store),
      first_(fetch_first_levels(store.reader())),
      shares_(shares),
      threads_(threads),
      access_(std::move(access)),
      connections_(std::move(connections)),
      watch_(store),
      surfaces_(store,
                {shares.surface, shares.surface_message / MeshMessage::kTriangleHeap, threads},
                range_of(store)),
      slices_(store, {shares.slice, shares.slice_message / MeshMessage::kTriangleHeap, threads},
              range_of(store)),
      files_(store, {shares.file, std::numeric_limits<std::uint64_t>::max(), threads},
             range_of(store)),
      surface_lane_(kMostWaiting),
      slice_lane_(kMostWaiting),
      file_lane_(kMostWaiting),
      small_lane_(kMostWaiting) {}

bool ViewService::are_labels() const {
    return store_.reader().layout().header().labels || store_.reader().label_names().size() > 0;
}

std::shared_ptr<Waiting> ViewService::handle(const HttpRequest& request, Reply reply) {
    std::shared_ptr<Waiting> waiting;
    bool started = false;
    HttpAnswer made = guarded([&]() -> HttpAnswer {
        RequestTarget target(request.target);
        const std::string path = target.path();
        const bool is_page = !path.starts_with("/api/");
        const std::string token = target.text("token").value_or("");
        if (const std::string why = why_refused(access_, request, token, is_page); !why.empty()) {
            return plain_error(403, "refused", why);
        }
        if (is_page) {
            const std::optional<PageFile> file = page_file(path);
            if (!file) {
                return plain_error(404, "not_found", "there is no such page");
            }
            return request.method == "GET"
                       ? HttpAnswer{200, std::string(file->type), file->bytes, {}}
                       : plain_error(405, "invalid_argument", "pages answer GET alone");
        }
        waiting = answer(request, std::move(target), reply);
        started = true;
        return {};
    });
    if (!started) {
        ++served_;
        reply(std::move(made));
    }
    return waiting;
}

std::shared_ptr<Waiting> ViewService::answer(const HttpRequest& request, RequestTarget target,
                                             const Reply& reply) {
    const std::string path = target.path();
    const auto at_once = [&](HttpAnswer made) -> std::shared_ptr<Waiting> {
        ++served_;
        reply(std::move(made));
        return nullptr;
    };
    const std::string stream = target.text("stream").value_or("");
    if (!stream.empty()) {
        Streams::require_name(stream);
    }
    const bool is_cancel = path == "/api/cancel";
    if (request.method != (is_cancel ? "POST" : "GET")) {
        return at_once(
            plain_error(405, "invalid_argument",
                        fmt::format("{} answers {} alone", path, is_cancel ? "POST" : "GET")));
    }
    if (is_cancel) {
        streams_.cancel(stream);
        return at_once({204, "text/plain", std::string(), {}});
    }
    if (path == "/api/status") {
        return at_once(status());
    }
    if (const StoreState state = watch_.state(); state != StoreState::same) {
        return at_once(
            plain_error(410, "corrupt",
                        fmt::format("{}: was {} since it was opened: start isonest view again",
                                    store_.path().string(), name_of(state))));
    }
    if (path == "/api/store") {
        return at_once(describe());
    }
    if (path == "/api/command") {
        return at_once(command(target));
    }
    if (path == "/api/label") {
        const auto id = target.integer("id", std::numeric_limits<std::int64_t>::min(),
                                       std::numeric_limits<std::int64_t>::max());
        target.require_all_taken();
        if (!id) {
            throw Error(ErrorKind::invalid_argument, "id is missing: a label");
        }
        return at_once(json_answer(label_json(store_, *id)));
    }
    if (path == "/api/surface" || path == "/api/slice") {
        return start_mesh(target, stream, reply);
    }
    if (path == "/api/export") {
        return start_file(target, stream, reply);
    }
    if (path == "/api/value") {
        return start_value(target, stream, reply);
    }
    if (path == "/api/histogram") {
        return start_histogram(target, stream, reply);
    }
    return at_once(plain_error(404, "not_found", fmt::format("there is nothing at {}", path)));
}

std::shared_ptr<Waiting> ViewService::start(WorkLane& lane, const std::string& stream, Work work,
                                            const Reply& reply) {
    auto job = std::make_shared<Job>();
    const bool taken = lane.add(job, [this, work = std::move(work), reply](Job& self) {
        HttpAnswer made = guarded([&] {
            self.check();
            return work(self);
        });
        ++served_;
        cancelled_ += self.cancelled() ? 1U : 0U;
        reply(std::move(made));
    });
    if (!taken) {
        ++served_;
        reply(plain_error(503, "limit", "too much work is waiting: ask again later"));
        return nullptr;
    }
    if (!stream.empty()) {
        streams_.replace(stream, job);
    }
    return job;
}

MeshRequest ViewService::take_mesh(RequestTarget& target, const std::string& path) const {
    const bool is_slice = path == "/api/slice" || (path != "/api/surface" && target.has("plane"));
    MeshRequest request = parse_mesh_request(target, is_slice, are_labels());
    target.require_all_taken();
    return request;
}

std::shared_ptr<Waiting> ViewService::start_mesh(RequestTarget& target, const std::string& stream,
                                                 const Reply& reply) {
    MeshRequest request = take_mesh(target, target.path());
    const bool is_slice = request.is_slice();
    return start(
        is_slice ? slice_lane_ : surface_lane_, stream,
        [this, request = std::move(request), is_slice](Progress& progress) {
            return (is_slice ? slices_ : surfaces_).message(request, progress);
        },
        reply);
}

std::shared_ptr<Waiting> ViewService::start_file(RequestTarget& target, const std::string& stream,
                                                 const Reply& reply) {
    const std::string ending = take_ending(target);
    MeshRequest request = take_mesh(target, target.path());
    return start(
        file_lane_, stream,
        [this, request = std::move(request), ending](Progress& progress) {
            return files_.file(request, ending, std::filesystem::temp_directory_path(), progress);
        },
        reply);
}

std::shared_ptr<Waiting> ViewService::start_value(RequestTarget& target, const std::string& stream,
                                                  const Reply& reply) {
    const auto at = target.numbers("at", 3, "x,y,z");
    target.require_all_taken();
    if (!at) {
        throw Error(ErrorKind::invalid_argument, "at is missing: x,y,z");
    }
    const Double3 place{(*at)[0], (*at)[1], (*at)[2]};
    return start(
        small_lane_, stream,
        [this, place](Progress& /*progress*/) {
            const PointValue found = value_at(store_, place, shares_.small);
            const auto value = [](const std::optional<double>& v) { return v ? Json(*v) : Json(); };
            Json json = {{"world", place},
                         {"node", array_of(found.node)},
                         {"inside", found.inside},
                         {"value", value(found.value)},
                         {"node_value", value(found.node_value)}};
            if (are_labels()) {
                const auto id =
                    found.node_value
                        ? label_of(*found.node_value, store_.reader().layout().header().labels)
                        : std::nullopt;
                json["value"] = nullptr;
                json["node_value"] = id ? Json(*id) : Json();
                json["name"] = id ? label_json(store_, *id)["name"] : Json();
            }
            return json_answer(json);
        },
        reply);
}

std::shared_ptr<Waiting> ViewService::start_histogram(RequestTarget& target,
                                                      const std::string& stream,
                                                      const Reply& reply) {
    const bool coarse = target.integer("coarse", 0, 1).value_or(0) == 1;
    target.require_all_taken();
    HistogramOptions options;
    options.memory = shares_.small;
    options.threads = threads_;
    if (coarse && first_) {
        options.level = first_->level;
        options.own_cubes = true;
    }
    return start(
        small_lane_, stream,
        [this, options](Progress& progress) {
            return json_answer(cli::histogram_json(histogram(store_.reader(), options, progress)));
        },
        reply);
}

HttpAnswer ViewService::describe() const {
    const bool any = store_.min_value() <= store_.max_value();
    const Int3 nodes = store_.nodes();
    const int dimension = int{nodes.x > 1} + int{nodes.y > 1} + int{nodes.z > 1};
    const bool integer = store_.type() != ValueType::f32 && store_.type() != ValueType::f64;
    Json json = {{"name", store_.path().filename().string()},
                 {"nodes", array_of(nodes)},
                 {"type", name_of(store_.type())},
                 {"spacing", store_.spacing()},
                 {"origin", store_.origin()},
                 {"direction", store_.direction()},
                 {"unit", store_.unit() ? Json(symbol_of(*store_.unit())) : Json()},
                 {"box", world_box(store_)},
                 {"min_value", any ? number(store_.min_value()) : Json()},
                 {"max_value", any ? number(store_.max_value()) : Json()},
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

HttpAnswer ViewService::status() const {
    const struct mallinfo2 heap = ::mallinfo2();
    Json json = {{"heap_bytes", heap.uordblks + heap.hblkhd},
                 {"memory", shares_.memory},
                 {"surface", int{surface_lane_.busy()}},
                 {"slice", int{slice_lane_.busy()}},
                 {"waiting", surface_lane_.waiting() + slice_lane_.waiting() +
                                 file_lane_.waiting() + small_lane_.waiting()},
                 {"served", served_.load()},
                 {"cancelled", cancelled_.load()},
                 {"connections", connections_()},
                 {"store", name_of(watch_.state())}};
    if (store_.is_remote()) {
        const FetchedCounts counts = store_.fetched();
        json["remote"] = {{"remote_bytes", counts.remote_bytes},
                          {"requests", counts.requests},
                          {"round_trips", counts.round_trips},
                          {"cache_bytes", counts.cache_bytes}};
    }
    return json_answer(json);
}

HttpAnswer ViewService::command(RequestTarget& target) const {
    const std::string ending = take_ending(target);
    const MeshRequest request = take_mesh(target, target.path());
    if (std::holds_alternative<AtMostTriangles>(request.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "a command is given for an error, a camera or a distance, not for a number of "
                    "triangles");
    }
    return json_answer(
        {{"command",
          command_line(request, store_, (request.is_slice() ? "slice." : "surface.") + ending)}});
}

}  // namespace isonest::detail::view
