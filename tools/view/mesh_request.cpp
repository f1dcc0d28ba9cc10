#include "tools/view/mesh_request.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <limits>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::view {

// Query strings as in the URL standard's application/x-www-form-urlencoded.

namespace {

constexpr std::size_t kMaxParameters = 32;

int hex_digit(char c) {
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    const char lower = static_cast<char>(static_cast<unsigned char>(c) | 0x20U);
    return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

std::string decoded(std::string_view text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] == '+') {
            out += ' ';
        } else if (text[i] == '%') {
            const int high = i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
            const int low = i + 2 < text.size() ? hex_digit(text[i + 2]) : -1;
            if (high < 0 || low < 0) {
                fail("the request has a % without two hexadecimal digits");
            }
            out += static_cast<char>(high * 16 + low);
            i += 2;
        } else {
            out += text[i];
        }
    }
    return out;
}

}  // namespace

[[noreturn]] void fail(const std::string& problem) {
    throw Error(ErrorKind::invalid_argument, problem);
}

RequestTarget::RequestTarget(std::string_view target) {
    const std::size_t end = target.find('?');
    path_ = decoded(target.substr(0, end));
    std::string_view rest = end == std::string_view::npos ? "" : target.substr(end + 1);
    while (!rest.empty()) {
        const std::size_t next = rest.find('&');
        const std::string_view one = rest.substr(0, next);
        rest = next == std::string_view::npos ? "" : rest.substr(next + 1);
        if (one.empty()) {
            continue;
        }
        const std::size_t equals = one.find('=');
        const std::string name = decoded(one.substr(0, equals));
        const std::string value =
            equals == std::string_view::npos ? "" : decoded(one.substr(equals + 1));
        if (!parameters_.emplace(name, value).second) {
            fail(fmt::format("duplicate parameter {}", name));
        }
        if (parameters_.size() > kMaxParameters) {
            fail("the request has too many parameters");
        }
    }
}

bool RequestTarget::has(const std::string& name) const {
    return parameters_.contains(name);
}

std::optional<std::string> RequestTarget::text(const std::string& name) {
    const auto found = parameters_.find(name);
    if (found == parameters_.end()) {
        return std::nullopt;
    }
    std::string value = std::move(found->second);
    parameters_.erase(found);
    return value;
}

std::optional<double> RequestTarget::number(const std::string& name, double lowest,
                                            double highest) {
    const std::optional<std::string> value = text(name);
    if (!value) {
        return std::nullopt;
    }
    const double number = cli::parse_number(name, *value);
    if (!(lowest <= number && number <= highest)) {
        fail(highest == std::numeric_limits<double>::max()
                 ? fmt::format("{} '{}': give a number of at least {:g}", name, *value, lowest)
                 : fmt::format("{} '{}': give a number from {:g} to {:g}", name, *value, lowest,
                               highest));
    }
    return number;
}

std::optional<std::int64_t> RequestTarget::integer(const std::string& name, std::int64_t lowest,
                                                   std::int64_t highest) {
    const std::optional<std::string> value = text(name);
    return value ? std::optional(cli::parse_integer(name, *value, lowest, highest)) : std::nullopt;
}

std::optional<std::vector<double>> RequestTarget::numbers(const std::string& name,
                                                          std::size_t count,
                                                          std::string_view form) {
    const std::optional<std::string> value = text(name);
    return value ? std::optional(cli::parse_numbers(name, *value, count, form)) : std::nullopt;
}

void RequestTarget::require_all_taken() const {
    if (!parameters_.empty()) {
        fail(fmt::format("unknown parameter {} of {}", parameters_.begin()->first, path_));
    }
}

namespace {

constexpr double kMax = std::numeric_limits<double>::max();
constexpr std::int64_t kMinTriangles = 100;
constexpr std::int64_t kMaxTriangles = 100'000'000;

std::optional<Camera> parse_camera(RequestTarget& target) {
    const auto v = target.numbers("camera", 6, "x,y,z,fov,height,pixels");
    if (!v) {
        return std::nullopt;
    }
    constexpr double kMaxHeight = 100'000;
    const double fov = (*v)[3];
    const double height = (*v)[4];
    const double pixels = (*v)[5];
    if (!(fov > 0 && fov < 180) || !(height >= 1 && height <= kMaxHeight) || !(pixels > 0)) {
        fail(
            "camera: the angle must be between 0 and 180 degrees, the height from 1 to 100000 "
            "pixels, and the error in pixels above 0");
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
    const auto iso = target.number("iso", -kMax, kMax);
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
    const auto triangles = target.integer("triangles", kMinTriangles, kMaxTriangles);
    const auto error = target.number("error", 0, kMax);
    const auto distance = is_slice ? std::nullopt : target.number("distance", 0, kMax);
    if (int{triangles.has_value()} + int{error.has_value()} + int{distance.has_value()} > 1) {
        fail(is_slice ? "give one of triangles and error"
                      : "give one of triangles, error and distance");
    }
    if (triangles) {
        return AtMostTriangles{static_cast<std::uint64_t>(*triangles)};
    }
    if (distance) {
        return DistanceBound{*distance};
    }
    return ErrorBound{error.value_or(0)};
}

/// Quotes a text for a POSIX shell.
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
    if (std::holds_alternative<DistanceBound>(request.stop)) {
        request.effort = parse_effort(target);
    }
    request.camera = parse_camera(target);
    request.box = parse_box(target);
    if (const auto limit = target.integer("limit", kMinTriangles, kMaxTriangles)) {
        request.limit = static_cast<std::uint64_t>(*limit);
    }
    if (const auto components = is_slice ? std::nullopt : target.text("components")) {
        if (*components != "largest" && *components != "all") {
            fail(fmt::format("components '{}': give largest or all", *components));
        }
        request.largest_component = *components == "largest";
    }
    if (const auto passes =
            is_slice ? std::nullopt : target.integer("smooth", 0, LabelSmoothing::kMaxPasses)) {
        if (!std::holds_alternative<LabelChoice>(request.what)) {
            fail("smooth needs a label");
        }
        if (std::holds_alternative<DistanceBound>(request.stop)) {
            fail("smooth and distance cannot be combined");
        }
        request.smooth = LabelSmoothing{static_cast<int>(*passes)};
    }
    if (const auto color = is_slice ? std::nullopt : target.text("color")) {
        request.color = *color;
    }
    if (request.camera && !std::holds_alternative<ErrorBound>(request.stop)) {
        fail("camera can be combined with an error only");
    }
    return request;
}

SurfaceQuery surface_query(const MeshRequest& request, const SurfaceStop& stop) {
    SurfaceQuery query;
    if (const auto* const iso = std::get_if<double>(&request.what)) {
        query.iso = *iso;
    }
    query.stop = stop;
    // An error changes with every move of a slider, and the nested grid is available at once.
    query.effort = std::holds_alternative<DistanceBound>(stop) ? request.effort : Effort::none;
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

ErrorBound possible_error(const ErrorBound& asked, const Store& store) {
    ErrorBound possible = asked;
    if (possible.value > 0) {
        possible.value = std::max(possible.value, store.rounding().tolerance);
    }
    return possible;
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
        line += fmt::format(" --error {}{}", possible_error(*error, store).value,
                            request.is_slice() ? "" : " --effort none");
    } else if (const auto* const distance = std::get_if<DistanceBound>(&request.stop)) {
        line += fmt::format(" --distance {}{}", distance->value,
                            request.effort == Effort::fast ? " --effort fast" : "");
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
        line += " --normals";  // like the page's meshes
    }
    if (request.color_store != nullptr) {
        line += " --vertex-values " +
                quoted(request.color + "=" + request.color_store->path().string());
    }
    return line + " -o " + quoted(output);
}

}  // namespace isonest::detail::view
