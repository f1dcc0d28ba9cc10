#include "tools/view/mesh_request.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <limits>

#include <isonest/error.h>

namespace isonest::detail::view {
namespace {

constexpr double kMost = std::numeric_limits<double>::max();
constexpr std::int64_t kLeastTriangles = 100;
constexpr std::int64_t kMostTriangles = 100'000'000;

std::optional<Camera> parse_camera(RequestTarget& target) {
    const auto v = target.numbers("camera", 6, "x,y,z,fov,height,pixels");
    if (!v) {
        return std::nullopt;
    }
    constexpr double kMostHeight = 100'000;
    const double fov = (*v)[3];
    const double height = (*v)[4];
    const double pixels = (*v)[5];
    if (!(fov > 0 && fov < 180) || !(height >= 1 && height <= kMostHeight) || !(pixels > 0)) {
        fail(
            "camera: the angle lies between 0 and 180 degrees, the height between 1 and 100000 "
            "pixels, and pixels above 0");
    }
    return Camera{{(*v)[0], (*v)[1], (*v)[2]}, fov, static_cast<int>(height), pixels};
}

std::optional<WorldBox> parse_box(RequestTarget& target) {
    const auto v = target.numbers("box", 6, "x0,y0,z0,x1,y1,z1");
    if (!v) {
        return std::nullopt;
    }
    return WorldBox{{(*v)[0], (*v)[1], (*v)[2]}, {(*v)[3], (*v)[4], (*v)[5]}};
}

std::variant<double, LabelChoice, WorldPlane> parse_what(RequestTarget& target, bool is_slice,
                                                         bool are_labels) {
    if (is_slice) {
        const auto v = target.numbers("plane", 4, "nx,ny,nz,d");
        if (!v) {
            fail("plane is missing: nx,ny,nz,d");
        }
        return WorldPlane{{(*v)[0], (*v)[1], (*v)[2]}, (*v)[3]};
    }
    if (const auto label = target.integer("label", std::numeric_limits<std::int64_t>::min(),
                                          std::numeric_limits<std::int64_t>::max())) {
        return LabelChoice{*label, {}};
    }
    const auto iso = target.number("iso", -kMost, kMost);
    if (!iso) {
        fail(are_labels ? "label is missing" : "iso is missing");
    }
    return *iso;
}

Effort parse_effort(RequestTarget& target) {
    const std::string effort = target.text("effort").value_or("best");
    if (effort != "best" && effort != "fast") {
        fail(fmt::format("effort '{}': give best or fast", effort));
    }
    return effort == "fast" ? Effort::fast : Effort::best;
}

std::variant<AtMostTriangles, ErrorBound, DistanceBound> parse_stop(RequestTarget& target,
                                                                    bool is_slice) {
    const auto triangles = target.integer("triangles", kLeastTriangles, kMostTriangles);
    const auto error = target.number("error", 0, kMost);
    const auto distance = is_slice ? std::nullopt : target.number("distance", 0, kMost);
    if (int{triangles.has_value()} + int{error.has_value()} + int{distance.has_value()} > 1) {
        fail(is_slice ? "give one of triangles and error"
                      : "give one of triangles, error and distance");
    }
    if (triangles) {
        return AtMostTriangles{static_cast<std::uint64_t>(*triangles)};
    }
    if (distance) {
        return DistanceBound{*distance, false, parse_effort(target)};
    }
    return ErrorBound{error.value_or(0)};
}

/// For a POSIX shell.
std::string quoted(const std::string& text) {
    constexpr std::string_view kPlain =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./,:+=@%";
    if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) {
        return text;
    }
    std::string out = "'";
    for (const char c : text) {
        out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    }
    return out + "'";
}

}  // namespace

MeshRequest parse_mesh_request(RequestTarget& target, bool is_slice, bool are_labels) {
    MeshRequest request;
    request.what = parse_what(target, is_slice, are_labels);
    request.stop = parse_stop(target, is_slice);
    request.camera = parse_camera(target);
    request.box = parse_box(target);
    if (const auto limit = target.integer("limit", kLeastTriangles, kMostTriangles)) {
        request.limit = static_cast<std::uint64_t>(*limit);
    }
    if (const auto components = is_slice ? std::nullopt : target.text("components")) {
        if (*components != "largest" && *components != "all") {
            fail(fmt::format("components '{}': give largest or all", *components));
        }
        request.largest_component = *components == "largest";
    }
    if (const auto passes =
            is_slice ? std::nullopt : target.integer("smooth", 0, LabelSmoothing::kMostPasses)) {
        if (!std::holds_alternative<LabelChoice>(request.what)) {
            fail("smooth goes with a label");
        }
        if (std::holds_alternative<DistanceBound>(request.stop)) {
            fail("smooth goes without a distance");
        }
        request.smooth = LabelSmoothing{static_cast<int>(*passes)};
    }
    if (request.camera && !std::holds_alternative<ErrorBound>(request.stop)) {
        fail("camera goes with an error, or alone");
    }
    return request;
}

SurfaceQuery surface_query(const MeshRequest& request, const SurfaceStop& stop) {
    SurfaceQuery query;
    if (const auto* const iso = std::get_if<double>(&request.what)) {
        query.iso = *iso;
    }
    query.stop = stop;
    query.camera = request.camera;
    query.box = request.box;
    if (request.largest_component) {
        query.stages.components = ComponentChoice{1, 0, 0};
    }
    query.attributes.normals = !request.smooth;
    return query;
}

LabelQuery label_query(const MeshRequest& request, const SurfaceStop& stop) {
    LabelQuery query =
        isonest::label_query(surface_query(request, stop), std::get<LabelChoice>(request.what));
    query.smooth = request.smooth;
    return query;
}

SliceQuery slice_query(const MeshRequest& request, const StopTest& stop) {
    SliceQuery query;
    query.plane = std::get<WorldPlane>(request.what);
    query.stop = stop;
    query.camera = request.camera;
    query.box = request.box;
    return query;
}

GraphQuery plane_query(const MeshRequest& request, const StopTest& stop, const Store& store) {
    GraphQuery query;
    query.scale = 0;
    query.stop = stop;
    query.camera = request.camera;
    query.box = request.box;
    query.attributes.values = &store;
    return query;
}

std::string command_line(const MeshRequest& request, const Store& store,
                         const std::string& output) {
    const bool is_plane = request.is_slice() && store.nodes().z == 1;
    const std::string name = quoted(store.path().string());
    std::string line =
        fmt::format("isonest {} {}", request.is_slice() && !is_plane ? "slice" : "extract", name);
    if (is_plane) {
        line += fmt::format(" --graph --scale 0 --vertex-values {}", name);
    } else if (const auto* const plane = std::get_if<WorldPlane>(&request.what)) {
        line += fmt::format(" --plane={},{}", fmt::join(plane->normal, ","), plane->offset);
    } else if (const auto* const label = std::get_if<LabelChoice>(&request.what)) {
        line += fmt::format(" --label={}", label->id);
    } else {
        line += fmt::format(" --iso={}", std::get<double>(request.what));
    }
    if (const auto* const error = std::get_if<ErrorBound>(&request.stop);
        error != nullptr && error->value > 0) {
        line += fmt::format(" --error {}", error->value);
    } else if (const auto* const distance = std::get_if<DistanceBound>(&request.stop)) {
        line += fmt::format(" --distance {}{}", distance->value,
                            distance->effort == Effort::fast ? " --effort fast" : "");
    }
    if (const std::optional<Camera>& c = request.camera) {
        line += fmt::format(" --camera={} --fov {} --height {} --pixels {}",
                            fmt::join(c->position, ","), c->field_of_view, c->height, c->pixels);
    }
    if (request.box) {
        line += fmt::format(" --box={},{}", fmt::join(request.box->lo, ","),
                            fmt::join(request.box->hi, ","));
    }
    if (request.largest_component) {
        line += " --components largest";
    }
    if (request.smooth) {
        line += fmt::format(" --smooth={}", request.smooth->passes);
    } else if (!request.is_slice()) {
        line += " --normals";  // as the meshes of the page have
    }
    return line + " -o " + quoted(output);
}

}  // namespace isonest::detail::view
