#include "tools/web/array_answers.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <variant>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "store/base/vectors.h"

namespace isonest::detail::web {

using Json = nlohmann::ordered_json;
using view::HttpAnswer;
using view::MeshRequest;
using view::RequestTarget;

namespace {

std::span<const std::byte> bytes_of(const auto& numbers) {
    return std::as_bytes(std::span(numbers));
}

}  // namespace

std::span<const std::byte> NumberArrays::bytes(int which) const {
    switch (which) {
        case 0:
            return bytes_of(positions);
        case 1:
            return bytes_of(normals);
        case 2:
            return bytes_of(values);
        default:
            return bytes_of(indices);
    }
}

void ArrayMesh::begin(const MeshLayout& layout) {
    layout_ = layout;
    const bool has_normals = layout.find("normal") != nullptr;
    const bool has_values = layout.find("value") != nullptr;
    const auto corners = static_cast<std::uint64_t>(layout.corners);
    const std::uint64_t numbers =
        layout.vertices * (3 + (has_normals ? 3 : 0) + (has_values ? 1 : 0)) +
        layout.elements * corners;
    if (numbers > memory_ / sizeof(float)) {
        throw Error(
            ErrorKind::limit,
            fmt::format("the mesh has {} {} and needs {} bytes; this memory leaves {} for a mesh",
                        layout.elements, corners == 3 ? "triangles" : "lines",
                        numbers * sizeof(float), memory_),
            {{RemedyKind::larger_error}, {RemedyKind::smaller_box}});
    }
    const auto vertices = static_cast<std::size_t>(layout.vertices);
    arrays_ = {};
    arrays_.positions.resize(3 * vertices);
    arrays_.normals.resize(has_normals ? 3 * vertices : 0);
    arrays_.values.resize(has_values ? vertices : 0);
    arrays_.indices.resize(static_cast<std::size_t>(layout.elements * corners));
}

void ArrayMesh::add_vertices(const VertexBatch& batch) {
    const VertexAttribute* const normal = layout_.find("normal");
    const VertexAttribute* const value = layout_.find("value");
    const auto first = static_cast<std::size_t>(batch.first);
    for (std::size_t i = 0; i < batch.positions.size(); ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::size_t at = 3 * (first + i) + axis;
            arrays_.positions[at] = batch.positions[i][axis];
            if (normal != nullptr) {
                arrays_.normals[at] =
                    static_cast<float>(batch.number(i, *normal, static_cast<int>(axis)));
            }
        }
        if (value != nullptr) {
            arrays_.values[first + i] = static_cast<float>(batch.number(i, *value));
        }
    }
}

void ArrayMesh::add_elements(const ElementBatch& batch) {
    const auto corners = static_cast<std::size_t>(layout_.corners);
    const auto first = static_cast<std::size_t>(batch.first);
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        for (std::size_t k = 0; k < corners; ++k) {
            arrays_.indices[corners * (first + i) + k] =
                static_cast<std::uint32_t>(batch.corners[i][k]);
        }
    }
}

// Rasterisation by edge functions: J. Pineda, "A parallel algorithm for polygon rasterization",
// SIGGRAPH 1988.

PixelValues::PixelValues(const PixelGrid& grid)
    : grid_(grid),
      values_(static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height),
              std::numeric_limits<float>::quiet_NaN()) {}

void PixelValues::add_elements(const ElementBatch& batch) {
    const VertexAttribute& value = *layout_.find("value");
    const double per_x = 1 / dot(grid_.right, grid_.right);
    const double per_y = 1 / dot(grid_.down, grid_.down);
    for (const auto& corners : batch.nearby_corners) {
        std::array<Corner, 3> t{};
        for (std::size_t k = 0; k < 3; ++k) {
            const auto& p = batch.nearby.positions[corners[k]];
            const Double3 from{static_cast<double>(p[0]) - grid_.origin[0],
                               static_cast<double>(p[1]) - grid_.origin[1],
                               static_cast<double>(p[2]) - grid_.origin[2]};
            t[k] = {dot(from, grid_.right) * per_x, dot(from, grid_.down) * per_y,
                    batch.nearby.number(corners[k], value)};
        }
        draw(t);
    }
}

void PixelValues::draw(const std::array<Corner, 3>& t) {
    const double area =
        (t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[1].y - t[0].y) * (t[2].x - t[0].x);
    if (area == 0 || !std::isfinite(area)) {
        return;
    }
    // The first and the last pixel between the smallest and the largest coordinate.
    const auto pixels = [](double a, double b, double c, int size) {
        const double most = static_cast<double>(size) - 1;
        return std::pair(
            static_cast<int>(std::ceil(std::clamp(std::min({a, b, c}), 0.0, most + 1))),
            static_cast<int>(std::floor(std::clamp(std::max({a, b, c}), -1.0, most))));
    };
    const auto [x0, x1] = pixels(t[0].x, t[1].x, t[2].x, grid_.width);
    const auto [y0, y1] = pixels(t[0].y, t[1].y, t[2].y, grid_.height);
    // Pixels on an edge belong to both triangles, which agree there. Positions are float32.
    constexpr double kSlack = 1e-6;
    for (int y = y0; y <= y1; ++y) {
        for (int x = x0; x <= x1; ++x) {
            std::array<double, 3> w{};
            double value = 0;
            for (std::size_t i = 0; i < 3; ++i) {
                const Corner& a = t[(i + 1) % 3];
                const Corner& b = t[(i + 2) % 3];
                w[i] = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
                value += w[i] * t[i].value;
            }
            if (std::min({w[0], w[1], w[2]}) >= -kSlack) {
                values_[static_cast<std::size_t>(y) * static_cast<std::size_t>(grid_.width) +
                        static_cast<std::size_t>(x)] = static_cast<float>(value);
            }
        }
    }
}

namespace {

/// What is known about an answer's mesh. The names are those of the commands' reports.
Json told_of(const ExtractReport& r, const Store& store) {
    Json told = {{"tolerance", r.tolerance},
                 {"error_bound", nullptr},
                 {"full_bound", nullptr},
                 {"distance_bound", nullptr},
                 {"smooth_bound", nullptr},
                 {"data_tolerance", r.data_tolerance},
                 {"value_rounding", r.value_rounding},
                 {"within_budget", nullptr},
                 {"area", nullptr},
                 {"volume", nullptr},
                 {"unit", store.unit() ? Json(symbol_of(*store.unit())) : Json()},
                 {"seconds", r.seconds},
                 {"chunks_read", r.traversal.chunks_read},
                 {"bytes_read", r.traversal.bytes_read}};
    if (r.distance) {
        told["tolerance"] = r.distance->asked;
        told["distance_bound"] = r.distance->bound;
    } else if (!r.smooth) {
        told["error_bound"] = r.error_bound;
    }
    if (r.simplified_error && r.simplified_error->full_bound &&
        std::isfinite(*r.simplified_error->full_bound)) {
        told["full_bound"] = *r.simplified_error->full_bound;
    }
    if (r.smooth) {
        told["smooth_bound"] = r.smooth->bound;
    }
    if (r.within_budget) {
        told["within_budget"] = *r.within_budget;
    }
    if (r.measures) {
        told["area"] = r.measures->area;
        told["volume"] = r.measures->volume ? Json(*r.measures->volume) : Json();
    }
    return told;
}

std::optional<Effort> take_effort(RequestTarget& request) {
    const std::optional<std::string> effort = request.text("effort");
    if (!effort) {
        return std::nullopt;
    }
    if (*effort == "none") {
        return Effort::none;
    }
    if (*effort != "fast" && *effort != "best") {
        view::fail(fmt::format("effort '{}': give none, fast or best", *effort));
    }
    return *effort == "fast" ? Effort::fast : Effort::best;
}

std::optional<Outside> take_close(RequestTarget& request) {
    const std::optional<std::string> close = request.text("close");
    if (!close) {
        return std::nullopt;
    }
    if (*close != "below" && *close != "above") {
        view::fail(fmt::format("close '{}': give below or above", *close));
    }
    return *close == "below" ? Outside::below : Outside::above;
}

Double3 take_vector(RequestTarget& request, const std::string& name) {
    const auto v = request.numbers(name, 3, "x,y,z");
    if (!v) {
        view::fail(fmt::format("{} is missing: x,y,z", name));
    }
    return {(*v)[0], (*v)[1], (*v)[2]};
}

/// Throws Error{limit} if the values need more than `memory` bytes.
PixelGrid take_pixels(RequestTarget& request, std::uint64_t memory) {
    constexpr std::int64_t kMaxSide = 1 << 15;
    PixelGrid grid;
    grid.origin = take_vector(request, "origin");
    grid.right = take_vector(request, "right");
    grid.down = take_vector(request, "down");
    const auto width = request.integer("width", 1, kMaxSide);
    const auto height = request.integer("height", 1, kMaxSide);
    if (!width || !height) {
        view::fail("width and height are needed");
    }
    if (!(dot(grid.right, grid.right) > 0) || !(dot(grid.down, grid.down) > 0)) {
        view::fail("right and down must not be zero");
    }
    const auto pixels = static_cast<std::uint64_t>(*width * *height);
    if (pixels * sizeof(float) > memory) {
        throw Error(ErrorKind::limit,
                    fmt::format("an image of {} x {} pixels needs {} bytes; this memory leaves {} "
                                "for an image",
                                *width, *height, pixels * sizeof(float), memory),
                    {{RemedyKind::smaller_picture}});
    }
    grid.width = static_cast<int>(*width);
    grid.height = static_cast<int>(*height);
    return grid;
}

/// How a surface is made, beyond what a MeshRequest says.
struct SurfaceMaking {
    SurfaceStop stop;
    std::optional<Effort> effort;
    std::optional<Outside> close;
    bool normals = true;
};

SurfaceQuery query_of(const MeshRequest& request, const SurfaceMaking& making) {
    SurfaceQuery query = view::surface_query(request, making.stop);
    query.effort = making.effort;
    query.stages.close = making.close;
    query.attributes.normals = making.normals && !request.smooth;
    return query;
}

SurfaceStop stop_of(const MeshRequest& request, std::optional<std::int64_t> triangles,
                    const Store& store) {
    if (triangles) {
        return TriangleBudgetByDistance{static_cast<std::uint64_t>(*triangles), std::nullopt};
    }
    if (const auto* const distance = std::get_if<DistanceBound>(&request.stop)) {
        return *distance;
    }
    return view::possible_error(std::get<ErrorBound>(request.stop), store);
}

void refuse_camera(const RequestTarget& request) {
    for (const char* const name : {"camera", "limit"}) {
        if (request.has(name)) {
            view::fail(fmt::format("unknown parameter {} of {}", name, request.path()));
        }
    }
}

}  // namespace

HttpAnswer ArrayAnswers::answer(RequestTarget& request, Progress& progress) {
    clear();
    refuse_camera(request);
    if (request.path() == "/arrays/surface") {
        return surface(request, progress);
    }
    if (request.path() == "/arrays/slice" || request.path() == "/arrays/image") {
        return slice(request, request.path() == "/arrays/image", progress);
    }
    return view::plain_error(404, "not_found",
                             fmt::format("there is nothing at {}", request.path()));
}

HttpAnswer ArrayAnswers::surface(RequestTarget& request, Progress& progress) {
    constexpr std::int64_t kMaxTriangles = 100'000'000;
    SurfaceMaking making;
    making.effort = take_effort(request);
    making.close = take_close(request);
    making.normals = request.integer("normals", 0, 1).value_or(1) == 1;
    const std::optional<std::int64_t> triangles = request.integer("triangles", 1, kMaxTriangles);
    if (triangles && (request.has("error") || request.has("distance"))) {
        view::fail("give one of triangles, error and distance");
    }
    const MeshRequest asked = view::parse_mesh_request(request, false, are_labels_);
    request.require_all_taken();
    making.stop = stop_of(asked, triangles, store_);

    ArrayMesh mesh(shares_.surface_message);
    ExtractOptions options;
    options.memory = shares_.surface;
    options.threads = 1;
    const SurfaceQuery query = query_of(asked, making);
    ExtractReport report;
    if (const auto* const label = std::get_if<LabelChoice>(&asked.what)) {
        LabelQuery of_label = label_query(query, *label);
        of_label.smooth = asked.smooth;
        report = extract(store_, of_label, mesh, options, progress);
    } else {
        report = extract(store_, query, mesh, options, progress);
    }
    arrays_ = std::move(mesh.arrays());
    Json told = told_of(report, store_);
    told["corners"] = mesh.layout().corners;
    return view::json_answer(told);
}

HttpAnswer ArrayAnswers::slice(RequestTarget& request, bool is_image, Progress& progress) {
    std::optional<PixelGrid> grid;
    if (is_image) {
        grid = take_pixels(request, shares_.slice_message);
    }
    const MeshRequest asked = view::parse_mesh_request(request, true, are_labels_);
    request.require_all_taken();
    const auto* const error = std::get_if<ErrorBound>(&asked.stop);
    if (error == nullptr) {
        view::fail("a slice has an error, and no number of triangles");
    }
    const ErrorBound stop = view::possible_error(*error, store_);
    ExtractOptions options;
    options.memory = shares_.slice;
    options.threads = 1;
    const auto run = [&](MeshSink& sink) {
        return store_.nodes().z == 1
                   ? extract(store_, view::plane_query(asked, stop, store_), sink, options,
                             progress)
                   : extract(store_, view::slice_query(asked, stop), sink, options, progress);
    };
    ExtractReport report;
    if (grid) {
        PixelValues pixels(*grid);
        report = run(pixels);
        arrays_.values = std::move(pixels.values());
    } else {
        ArrayMesh mesh(shares_.slice_message);
        report = run(mesh);
        arrays_ = std::move(mesh.arrays());
    }
    Json told = told_of(report, store_);
    told["corners"] = 3;
    return view::json_answer(told);
}

}  // namespace isonest::detail::web
