#include "tools/view/view_service.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <climits>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <utility>
#include <variant>

#include <isonest/error.h>
#include <isonest/mesh_file.h>

#include "store/files/scratch_file.h"
#include "tools/view/mesh_answers.h"
#include "tools/view/mesh_message.h"
#include "tools/view/page_files.h"
#include "tools/view/store_answers.h"

namespace isonest::detail::view {
namespace {

struct Listed {
    std::atomic<bool> is_set{false};
    std::array<char, PATH_MAX> name{};
};

/// One per connection, and some whose connection is closed.
constexpr std::size_t kMaxListed = 192;
std::array<Listed, kMaxListed> folders;

/// The layout that getdents64 writes.
struct Entry {
    std::uint64_t inode;
    std::int64_t offset;
    std::uint16_t length;
    std::uint8_t type;
    char name[1];
};

void remove_files_in(int folder) {
    constexpr std::size_t kBytes = 4096;
    alignas(Entry) std::array<char, kBytes> entries{};
    for (;;) {
        const long got = ::syscall(SYS_getdents64, folder, entries.data(), entries.size());
        if (got <= 0) {
            return;
        }
        for (std::size_t at = 0; at < static_cast<std::size_t>(got);) {
            const auto* const entry = reinterpret_cast<const Entry*>(entries.data() + at);
            at += entry->length;
            ::unlinkat(folder, static_cast<const char*>(entry->name), 0);
        }
    }
}

}  // namespace

void list_folder(const std::filesystem::path& folder) {
    const std::string name = std::filesystem::absolute(folder).string();
    if (name.size() >= PATH_MAX) {
        return;
    }
    for (Listed& one : folders) {
        std::error_code ignored;
        if (one.is_set.load() && std::filesystem::exists(one.name.data(), ignored)) {
            continue;
        }
        one.is_set.store(false);
        std::memcpy(one.name.data(), name.c_str(), name.size() + 1);
        one.is_set.store(true);
        return;
    }
}

void remove_listed_folders() {
    for (const Listed& one : folders) {
        // Another thread may create a file while this one removes them.
        for (int tries = 0; tries < 3 && one.is_set.load(); ++tries) {
            const int folder =
                ::open(one.name.data(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
            if (folder < 0) {
                break;
            }
            remove_files_in(folder);
            ::close(folder);
            if (::rmdir(one.name.data()) == 0) {
                break;
            }
        }
    }
}

void Streams::require_name(const std::string& name) {
    constexpr std::size_t kMaxLetters = 64;
    const bool good = std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) != 0 || c == '-' || c == '_';
    });
    if (name.empty() || name.size() > kMaxLetters || !good) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("stream '{}': give 1 to {} letters, digits, - or _",
                                name.substr(0, kMaxLetters), kMaxLetters));
    }
}

void Streams::replace(const std::string& name, const std::shared_ptr<Job>& job) {
    std::erase_if(jobs_, [](const auto& entry) { return entry.second.expired(); });
    cancel(name);
    jobs_[name] = job;
}

void Streams::cancel(const std::string& name) {
    const auto found = jobs_.find(name);
    if (found == jobs_.end()) {
        return;
    }
    if (const std::shared_ptr<Job> job = found->second.lock()) {
        job->cancel();
    }
    jobs_.erase(found);
}

// Meshes as files: only a page with a server gets them.

namespace {

/// Creates a folder below `scratch`.
std::filesystem::path new_folder(const std::filesystem::path& scratch) {
    std::string name = (scratch / "isonest-view-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
        throw Error(
            ErrorKind::io, {scratch.string()},
            fmt::format("cannot make a folder: {}", std::generic_category().message(errno)));
    }
    return name;
}

}  // namespace

HttpAnswer MeshAnswers::file(const Store& store, const MeshRequest& request,
                             const std::string& ending, const std::filesystem::path& scratch,
                             Progress& progress) {
    if (std::holds_alternative<AtMostTriangles>(request.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "mesh files need an error, a camera or a distance, not a number of triangles");
    }
    const std::string name = (request.is_slice() ? "slice." : "surface.") + ending;
    const std::filesystem::path folder = new_folder(scratch);
    SentFile file(folder, folder / name);
    list_folder(folder);
    const auto* const choice = std::get_if<LabelChoice>(&request.what);
    const LabelName label =
        choice != nullptr ? store.label_name(choice->id).value_or(LabelName{}) : LabelName{};
    const std::unique_ptr<MeshSink> sink =
        open_mesh_file(file.path(), {.title = label.name, .color = label.color});
    extract_to(*sink, store, request, 0, progress);
    return {200, "application/octet-stream", std::move(file), name};
}

namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxWaiting = 16;

/// The file name extension: only letters and digits, so that it cannot lead into another folder or
/// end a header.
std::string take_ending(RequestTarget& target) {
    std::string ending = target.text("format").value_or("ply");
    if (!std::all_of(ending.begin(), ending.end(),
                     [](unsigned char c) { return std::isalnum(c) != 0; })) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("format '{}': give the file name extension of a mesh format, such as ply",
                        ending));
    }
    return ending;
}

}  // namespace

ViewService::ViewService(ViewedSteps& steps, const MemoryShares& shares, int threads, Access access,
                         std::function<std::size_t()> connections)
    : steps_(steps),
      shares_(shares),
      access_(std::move(access)),
      connections_(std::move(connections)),
      surfaces_({shares.surface, shares.surface_message / MeshMessage::kTriangleHeap, threads},
                steps.range()),
      slices_({shares.slice, shares.slice_message / MeshMessage::kTriangleHeap, threads},
              steps.range()),
      files_({shares.file, std::numeric_limits<std::uint64_t>::max(), threads}, steps.range()),
      tiles_(steps, shares.file, threads),
      surface_lane_(kMaxWaiting),
      slice_lane_(kMaxWaiting),
      file_lane_(kMaxWaiting),
      small_lane_(kMaxWaiting) {}

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
                       : plain_error(405, "invalid_argument", "pages support only GET");
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
                        fmt::format("{} supports only {}", path, is_cancel ? "POST" : "GET")));
    }
    if (is_cancel) {
        target.require_all_taken();
        Streams::require_name(stream);
        streams_.cancel(stream);
        tiles_.cancel(stream);
        return at_once({204, "text/plain", std::string(), {}});
    }
    if (path == "/api/status") {
        target.require_all_taken();
        return at_once(status());
    }
    const std::size_t step = take_step(target);
    if (const StoreState state = steps_.state(step); state != StoreState::same) {
        return at_once(
            plain_error(410, "corrupt",
                        fmt::format("{}: was {} since it was opened: start isonest view again",
                                    steps_.path(step).string(), name_of(state))));
    }
    if (path == "/api/store") {
        target.require_all_taken();
        return at_once(steps_.first().answers.describe(steps_.series()));
    }
    if (path == "/api/command") {
        return at_once(command(step, target));
    }
    if (path == "/api/label") {
        return at_once(steps_.open(step)->answers.label(target));
    }
    if (path == "/api/labels") {
        const bool named = StoreAnswers::take_labels(target);
        return start(small_lane_, stream,
                     on_step(step,
                             [named](const OpenStep& opened, Progress& progress) {
                                 return opened.answers.labels(named, progress);
                             }),
                     reply);
    }
    if (path == "/api/surface" || path == "/api/slice") {
        return start_mesh(step, target, stream, reply);
    }
    if (path == "/api/tiles") {
        return at_once(tiles_.state(step, target, stream, file_lane_));
    }
    if (path.starts_with("/api/tileset/")) {
        target.require_all_taken();
        return at_once(tiles_.file(path));
    }
    if (path == "/api/export") {
        tiles_.make_way();
        return start_file(step, target, stream, reply);
    }
    if (path == "/api/value") {
        const Double3 place = StoreAnswers::take_place(target);
        return start(
            small_lane_, stream,
            on_step(step, [place](const OpenStep& opened,
                                  Progress& /*progress*/) { return opened.answers.value(place); }),
            reply);
    }
    if (path == "/api/histogram") {
        const HistogramOptions options = steps_.first().answers.take_histogram(target);
        return start(small_lane_, stream,
                     on_step(step,
                             [options](const OpenStep& opened, Progress& progress) {
                                 return opened.answers.histogram(options, progress);
                             }),
                     reply);
    }
    return at_once(plain_error(404, "not_found", fmt::format("there is nothing at {}", path)));
}

std::size_t ViewService::take_step(RequestTarget& target) const {
    const auto last = static_cast<std::int64_t>(steps_.count()) - 1;
    return static_cast<std::size_t>(target.integer("step", 0, last).value_or(0));
}

ViewService::Work ViewService::on_step(std::size_t step, StepWork work) {
    return [this, step, work = std::move(work)](Progress& progress) {
        const std::shared_ptr<const OpenStep> opened = steps_.open(step);
        return work(*opened, progress);
    };
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
        reply(plain_error(503, "limit", "the server is busy: try again later"));
        return nullptr;
    }
    if (!stream.empty()) {
        streams_.replace(stream, job);
    }
    return job;
}

std::shared_ptr<Waiting> ViewService::start_mesh(std::size_t step, RequestTarget& target,
                                                 const std::string& stream, const Reply& reply) {
    // What a request may contain depends only on the type of the values, which all steps share.
    MeshRequest request = steps_.first().answers.take_mesh(target, target.path());
    const bool is_slice = request.is_slice();
    return start(is_slice ? slice_lane_ : surface_lane_, stream,
                 on_step(step,
                         [this, request = std::move(request), is_slice](const OpenStep& opened,
                                                                        Progress& progress) {
                             MeshAnswers& meshes = is_slice ? slices_ : surfaces_;
                             return meshes.message(opened.store, request, progress);
                         }),
                 reply);
}

std::shared_ptr<Waiting> ViewService::start_file(std::size_t step, RequestTarget& target,
                                                 const std::string& stream, const Reply& reply) {
    const std::string ending = take_ending(target);
    MeshRequest request = steps_.first().answers.take_mesh(target, target.path());
    return start(file_lane_, stream,
                 on_step(step,
                         [this, request = std::move(request), ending](const OpenStep& opened,
                                                                      Progress& progress) {
                             return files_.file(opened.store, request, ending, temporary_folder(),
                                                progress);
                         }),
                 reply);
}

HttpAnswer ViewService::status() const {
    const struct mallinfo2 heap = ::mallinfo2();
    Json json = {{"heap_bytes", heap.uordblks + heap.hblkhd},
                 {"memory", shares_.memory},
                 {"surface", int{surface_lane_.busy()}},
                 {"slice", int{slice_lane_.busy()}},
                 {"file", int{file_lane_.busy()}},
                 {"waiting", surface_lane_.waiting() + slice_lane_.waiting() +
                                 file_lane_.waiting() + small_lane_.waiting()},
                 {"served", served_.load()},
                 {"cancelled", cancelled_.load()},
                 {"connections", connections_()},
                 {"store", name_of(steps_.state())}};
    if (const Store& store = steps_.first().store; store.is_remote()) {
        const FetchedCounts counts = store.fetched();
        json["remote"] = {{"remote_bytes", counts.remote_bytes},
                          {"requests", counts.requests},
                          {"round_trips", counts.round_trips},
                          {"cache_bytes", counts.cache_bytes}};
    }
    return json_answer(json);
}

HttpAnswer ViewService::command(std::size_t step, RequestTarget& target) {
    const std::string ending = take_ending(target);
    const std::shared_ptr<const OpenStep> opened = steps_.open(step);
    const MeshRequest request = opened->answers.take_mesh(target, target.path());
    if (std::holds_alternative<AtMostTriangles>(request.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "commands need an error, a camera or a distance, not a number of triangles");
    }
    const std::string file = (request.is_slice() ? "slice." : "surface.") + ending;
    open_mesh_file(file);  // throws if no format has this extension, and creates no file
    return json_answer({{"command", command_line(request, opened->store, file)}});
}

}  // namespace isonest::detail::view
