#include "tools/view/view_service.h"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cctype>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include <isonest/error.h>
#include <isonest/mesh_file.h>

#include "store/files/scratch_file.h"
#include "tools/view/answers/answers.h"
#include "tools/view/mesh_message.h"
#include "tools/view/page_files.h"

namespace isonest::detail::view {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostWaiting = 16;

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

}  // namespace

ViewService::ViewService(const Store& store, const MemoryShares& shares, int threads, Access access,
                         std::function<std::size_t()> connections)
    : store_(store),
      shares_(shares),
      answers_(store, shares, threads),
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
        target.require_all_taken();
        Streams::require_name(stream);
        streams_.cancel(stream);
        return at_once({204, "text/plain", std::string(), {}});
    }
    if (path == "/api/status") {
        target.require_all_taken();
        return at_once(status());
    }
    if (const StoreState state = watch_.state(); state != StoreState::same) {
        return at_once(
            plain_error(410, "corrupt",
                        fmt::format("{}: was {} since it was opened: start isonest view again",
                                    store_.path().string(), name_of(state))));
    }
    if (path == "/api/store") {
        target.require_all_taken();
        return at_once(answers_.describe());
    }
    if (path == "/api/command") {
        return at_once(command(target));
    }
    if (path == "/api/label") {
        return at_once(answers_.label(target));
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
        const HistogramOptions options = answers_.take_histogram(target);
        return start(
            small_lane_, stream,
            [this, options](Progress& progress) { return answers_.histogram(options, progress); },
            reply);
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

std::shared_ptr<Waiting> ViewService::start_mesh(RequestTarget& target, const std::string& stream,
                                                 const Reply& reply) {
    MeshRequest request = answers_.take_mesh(target, target.path());
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
    MeshRequest request = answers_.take_mesh(target, target.path());
    return start(
        file_lane_, stream,
        [this, request = std::move(request), ending](Progress& progress) {
            return files_.file(request, ending, temporary_folder(), progress);
        },
        reply);
}

std::shared_ptr<Waiting> ViewService::start_value(RequestTarget& target, const std::string& stream,
                                                  const Reply& reply) {
    const Double3 place = StoreAnswers::take_place(target);
    return start(
        small_lane_, stream,
        [this, place](Progress& /*progress*/) { return answers_.value(place); }, reply);
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
    const MeshRequest request = answers_.take_mesh(target, target.path());
    if (std::holds_alternative<AtMostTriangles>(request.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "a command is given for an error, a camera or a distance, not for a number of "
                    "triangles");
    }
    const std::string file = (request.is_slice() ? "slice." : "surface.") + ending;
    open_mesh_file(file);  // throws for the end of a name that no format has, and makes no file
    return json_answer({{"command", command_line(request, store_, file)}});
}

}  // namespace isonest::detail::view
