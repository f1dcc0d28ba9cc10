#include "tools/view/mesh_answers.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "tools/view/mesh_message.h"

namespace isonest::detail::view {
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
        header["full_resolution"] = r.error_bound == (request.is_slice() ? r.value_rounding : 0);
    }
    return header;
}

HttpAnswer as_answer(MeshMessage& mesh, const MeshRequest& request, const ExtractReport& report) {
    if (report.smooth) {
        mesh.make_normals();
    }
    return {200, "application/octet-stream", mesh.finish(header_of(request, report, mesh)), {}};
}

/// A slider waits for the answer; who asked for a limit waits for the best mesh.
constexpr double kSliderSeconds = 0.04;
constexpr double kPatience = 2;

}  // namespace

ExtractReport MeshAnswers::extract_to(MeshSink& sink, const MeshRequest& request, double rounding,
                                      Progress& progress) const {
    ExtractOptions options;
    options.memory = budget_.memory;
    options.threads = budget_.threads;
    if (request.is_slice() && store_.nodes().z == 1) {
        return extract(store_, plane_query(request, std::get<ErrorBound>(request.stop), store_),
                       sink, options, progress);
    }
    if (request.is_slice()) {
        return extract(store_, slice_query(request, std::get<ErrorBound>(request.stop)), sink,
                       options, progress);
    }
    const auto* const distance = std::get_if<DistanceBound>(&request.stop);
    const SurfaceStop stop =
        distance != nullptr
            ? SurfaceStop(DistanceBound{distance->value - rounding, false, distance->effort})
            : SurfaceStop(std::get<ErrorBound>(request.stop));
    if (std::holds_alternative<LabelChoice>(request.what)) {
        return extract(store_, label_query(request, stop), sink, options, progress);
    }
    return extract(store_, surface_query(request, stop), sink, options, progress);
}

/// What rounding positions may take of the distance asked for: nothing if that is smaller.
double MeshAnswers::rounding_within(const MeshRequest& request) const {
    const auto* const distance = std::get_if<DistanceBound>(&request.stop);
    if (distance == nullptr) {
        return 0;
    }
    double square = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double extent = store_.spacing()[axis] *
                              static_cast<double>(store_.nodes()[static_cast<int>(axis)] - 1);
        square += extent * extent;
    }
    // A mesh of a rotated volume lies in a box that is as long as the diagonal at most.
    const double most =
        MeshMessage::rounding_of({std::sqrt(square), std::sqrt(square), std::sqrt(square)});
    return 2 * most < distance->value ? most : 0;
}

HttpAnswer MeshAnswers::within_triangles(MeshRequest request, std::uint64_t most, double seconds,
                                         Progress& progress) {
    request.camera.reset();
    ErrorChoice::Search search(choice_, std::min(most, budget_.most_triangles), seconds);
    HttpAnswer answer;
    std::uint64_t fewest = 0;
    while (const std::optional<double> error = search.next()) {
        request.stop = ErrorBound{*error};
        MeshMessage mesh(std::min(most, budget_.most_triangles));
        const auto start = std::chrono::steady_clock::now();
        std::uint64_t triangles = 0;
        try {
            const ExtractReport report = extract_to(mesh, request, 0, progress);
            triangles = report.triangles;
            answer = as_answer(mesh, request, report);
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
        throw Error(ErrorKind::limit, {store_.path().string()},
                    fmt::format("the coarsest mesh has {} triangles, more than {}", fewest, most));
    }
    return answer;
}

HttpAnswer MeshAnswers::within_stop(const MeshRequest& request, Progress& progress) {
    const bool has_limit = request.limit && *request.limit <= budget_.most_triangles;
    MeshMessage mesh(has_limit ? *request.limit : budget_.most_triangles);
    try {
        const ExtractReport report = extract_to(mesh, request, rounding_within(request), progress);
        return as_answer(mesh, request, report);
    } catch (const TooManyTriangles& e) {
        if (request.limit && !std::holds_alternative<LabelChoice>(request.what)) {
            return within_triangles(request, *request.limit, kPatience, progress);
        }
        throw Error(ErrorKind::limit, {store_.path().string()},
                    fmt::format("the mesh has {} triangles; this memory is enough for {}",
                                e.triangles, budget_.most_triangles),
                    request.smooth ? std::vector<Remedy>{{RemedyKind::more_memory}}
                                   : std::vector<Remedy>{{RemedyKind::larger_error},
                                                         {RemedyKind::smaller_box}});
    }
}

HttpAnswer MeshAnswers::message(const MeshRequest& request, Progress& progress) {
    if (const auto* const most = std::get_if<AtMostTriangles>(&request.stop)) {
        return within_triangles(request, most->most, kSliderSeconds, progress);
    }
    return within_stop(request, progress);
}

}  // namespace isonest::detail::view
