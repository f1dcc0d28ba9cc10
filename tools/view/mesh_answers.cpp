#include "tools/view/mesh_answers.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/container/format.h"
#include "store/container/reader.h"
#include "tools/view/mesh_message.h"

namespace isonest::detail::view {

// On smooth data, the number of triangles doubles when the error is halved: the error is quadratic
// in the size of an element, and the number of triangles is quadratic in the inverse of the size.
// On other data it grows faster; each search corrects the assumption of the last one.

namespace {

/// With less than a third of the permitted triangles, another try is worthwhile.
constexpr double kFew = 3;
/// Conservative factor by which one finer step increases the number of triangles.
constexpr double kGrowth = 2;

}  // namespace

double ErrorChoice::error(int step) const {
    return step > kMaxStep ? 0 : 2 * range_ * std::exp2(-0.5 * step);
}

void ErrorChoice::learn(const Search& search) {
    if (search.best_step() >= 0) {
        start_ = search.best_step();
    }
}

ErrorChoice::Search::Search(const ErrorChoice& choice, std::uint64_t most, double seconds)
    : choice_(&choice), max_(most), seconds_(seconds), step_(choice.start_) {}

std::optional<double> ErrorChoice::Search::next() const {
    return ended_ ? std::nullopt : std::optional(choice_->error(step_));
}

std::optional<double> ErrorChoice::Search::best() const {
    return best_ < 0 ? std::nullopt : std::optional(choice_->error(best_));
}

void ErrorChoice::Search::tried(std::uint64_t triangles, double seconds) {
    spent_ += seconds;
    const double part = static_cast<double>(triangles) / static_cast<double>(max_);
    if (triangles > max_) {
        too_fine_ = std::min(too_fine_, step_);
        const int back = std::max(1, static_cast<int>(std::ceil(std::log2(part))));
        step_ = std::max(step_ - back, best_ >= 0 ? best_ + 1 : 0);
        // Ends with a mesh, or at the coarsest step.
        ended_ = best_ >= 0 || too_fine_ == 0;
        return;
    }
    best_ = step_;
    const int forth =
        triangles == 0 ? 2 : static_cast<int>(std::floor(std::log(1 / part) / std::log(kGrowth)));
    step_ = std::min({step_ + std::max(forth, 1), too_fine_ - 1, kMaxStep + 1});
    ended_ = step_ <= best_ || part * kFew > 1 || spent_ > seconds_;
}

namespace {

using Json = nlohmann::ordered_json;

Json header_of(const MeshRequest& request, const ExtractReport& r, const MeshMessage& mesh) {
    const bool distance = r.distance.has_value();
    Json header = {{"stop", distance         ? "distance"
                            : request.camera ? "camera"
                            : r.smooth       ? "smooth"
                                             : "error"},
                   {"tolerance", distance ? r.distance->asked : r.tolerance},
                   {"error_bound", nullptr},
                   {"data_tolerance", r.data_tolerance},
                   {"distance_bound", nullptr},
                   {"smooth_bound", nullptr},
                   {"full_resolution", false},
                   {"seconds", r.seconds},
                   {"chunks_read", r.traversal.chunks_read},
                   {"bytes_read", r.traversal.bytes_read}};
    if (r.smooth) {
        header["smooth_bound"] = r.smooth->bound + mesh.position_rounding();
        header["full_resolution"] = !distance;
    }
    if (distance) {
        if (const auto* const asked = std::get_if<DistanceBound>(&request.stop)) {
            header["tolerance"] = asked->value;
        }
        header["distance_bound"] = r.distance->bound + mesh.position_rounding();
        header["full_resolution"] = r.distance->asked == 0;
    } else if (!r.smooth) {
        header["error_bound"] = r.error_bound;
        header["full_resolution"] =
            r.error_bound == (request.is_slice() ? r.value_rounding : 0) + r.data_tolerance;
    }
    return header;
}

std::string value_name(const MeshRequest& request) {
    return request.color_store != nullptr ? request.color : "value";
}

HttpAnswer as_answer(MeshMessage& mesh, const MeshRequest& request, const ExtractReport& report,
                     const std::optional<VertexFieldReport>& color) {
    if (report.smooth) {
        mesh.make_normals();
    }
    Json header = header_of(request, report, mesh);
    if (color) {
        const bool is_bounded = color->bounded_elements > 0 || color->unbounded_elements == 0;
        header["color"] = color->name;
        header["color_bound"] = is_bounded ? Json(color->linear_bound) : Json();
        header["uncolored_triangles"] = color->unbounded_elements;
    }
    return {200, "application/octet-stream", mesh.finish(std::move(header)), {}};
}

/// A slider needs its answer at once; a user who set a limit waits for the best mesh.
constexpr double kSliderSeconds = 0.04;
constexpr double kPatience = 2;

}  // namespace

namespace {

ExtractReport extract_one(MeshSink& sink, const Store& store, const MeshRequest& request,
                          double rounding, const ExtractOptions& options, Progress& progress) {
    const auto error = [&] { return possible_error(std::get<ErrorBound>(request.stop), store); };
    if (request.is_slice() && store.nodes().z == 1) {
        return extract(store, plane_query(request, error(), store), sink, options, progress);
    }
    if (request.is_slice()) {
        return extract(store, slice_query(request, error()), sink, options, progress);
    }
    const auto* const distance = std::get_if<DistanceBound>(&request.stop);
    const SurfaceStop stop = distance != nullptr
                                 ? SurfaceStop(DistanceBound{distance->value - rounding})
                                 : SurfaceStop(error());
    if (std::holds_alternative<LabelChoice>(request.what)) {
        return extract(store, label_query(request, stop), sink, options, progress);
    }
    return extract(store, surface_query(request, stop), sink, options, progress);
}

}  // namespace

MeshAnswers::Extracted MeshAnswers::extract_to(MeshSink& sink, const Store& store,
                                               const MeshRequest& request, double rounding,
                                               Progress& progress) const {
    ExtractOptions options;
    options.memory = budget_.memory;
    options.threads = budget_.threads;
    if (request.color_store == nullptr) {
        return {extract_one(sink, store, request, rounding, options, progress), std::nullopt};
    }
    const std::uint64_t of_color = options.memory / 4;
    options.memory -= of_color;
    VertexFields fields({{request.color, {request.color_store}}}, {of_color, budget_.threads});
    const std::unique_ptr<MeshSink> colored = fields.sink(sink);
    const ExtractReport report = extract_one(*colored, store, request, rounding, options, progress);
    return {report, fields.reports().front()};
}

namespace {

/// The part of the requested distance that rounding positions may take: none if the distance is too
/// small.
double rounding_within(const Store& store, const MeshRequest& request) {
    const auto* const distance = std::get_if<DistanceBound>(&request.stop);
    if (distance == nullptr) {
        return 0;
    }
    // The box of a rotated volume's mesh is at most as long as the diagonal.
    const double diagonal = diagonal_of(store.reader().layout().header());
    const double most = MeshMessage::rounding_of({diagonal, diagonal, diagonal});
    return 2 * most < distance->value ? most : 0;
}

}  // namespace

HttpAnswer MeshAnswers::within_triangles(const Store& store, MeshRequest request,
                                         std::uint64_t most, double seconds, Progress& progress) {
    request.camera.reset();
    ErrorChoice::Search search(choice_, std::min(most, budget_.max_triangles), seconds);
    HttpAnswer answer;
    std::uint64_t fewest = 0;
    while (const std::optional<double> error = search.next()) {
        request.stop = ErrorBound{*error};
        MeshMessage mesh(std::min(most, budget_.max_triangles), value_name(request));
        const auto start = std::chrono::steady_clock::now();
        std::uint64_t triangles = 0;
        try {
            const Extracted made = extract_to(mesh, store, request, 0, progress);
            triangles = made.report.triangles;
            answer = as_answer(mesh, request, made.report, made.color);
        } catch (const TooManyTriangles& e) {
            triangles = e.triangles;
            fewest = e.triangles;
        }
        search.tried(
            triangles,
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    choice_.learn(search);
    if (!search.best()) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("the coarsest mesh has {} triangles, more than {}", fewest, most));
    }
    return answer;
}

HttpAnswer MeshAnswers::within_stop(const Store& store, const MeshRequest& request,
                                    Progress& progress) {
    const bool has_limit = request.limit && *request.limit <= budget_.max_triangles;
    MeshMessage mesh(has_limit ? *request.limit : budget_.max_triangles, value_name(request));
    try {
        const Extracted made =
            extract_to(mesh, store, request, rounding_within(store, request), progress);
        return as_answer(mesh, request, made.report, made.color);
    } catch (const TooManyTriangles& e) {
        if (request.limit && !std::holds_alternative<LabelChoice>(request.what)) {
            return within_triangles(store, request, *request.limit, kPatience, progress);
        }
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("the mesh has {} triangles; this memory is enough for {}",
                                e.triangles, budget_.max_triangles),
                    request.smooth ? std::vector<Remedy>{{RemedyKind::more_memory}}
                                   : std::vector<Remedy>{{RemedyKind::larger_error},
                                                         {RemedyKind::smaller_box}});
    }
}

HttpAnswer MeshAnswers::message(const Store& store, const MeshRequest& request,
                                Progress& progress) {
    if (const auto* const most = std::get_if<AtMostTriangles>(&request.stop)) {
        return within_triangles(store, request, most->most, kSliderSeconds, progress);
    }
    return within_stop(store, request, progress);
}

}  // namespace isonest::detail::view
