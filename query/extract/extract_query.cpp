#include "query/extract/extract_query.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "query/march/contour_lines.h"
#include "query/mesh/mesh_writer.h"
#include "store/lattice/extent.h"

namespace isonest::detail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double tolerance_of(const StoreReader& store, const ExtractOptions& options) {
    if (options.error && options.error_relative) {
        throw Error(
            ErrorKind::invalid_argument,
            "give the error either in units of the data or relative to its range, not both");
    }
    double tolerance = options.error.value_or(0);
    if (options.error_relative) {
        // Each part by itself: the range of doubles may be beyond them.
        const double r = *options.error_relative;
        tolerance = store.max_value() > store.min_value()
                        ? r * store.max_value() - r * store.min_value()
                        : r * 0;
    }
    if (!(tolerance >= 0) || !std::isfinite(tolerance)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("error {}: must be a finite number >= 0", tolerance));
    }
    return tolerance;
}

void require(const StoreReader& store, Field field, const std::string& what) {
    const StoreLayout& layout = store.layout();
    if (!layout.has(field) && layout.lattice().top() > 0) {
        std::vector<Field> wanted = layout.header().fields;
        wanted.push_back(field);
        throw Error(
            ErrorKind::not_found,
            fmt::format(
                "{}: {} needs the field {}; the store has {}. Choose another, or preprocess "
                "the volume again with --indicators {}",
                store.path().string(), what, name_of(field),
                layout.header().fields.empty() ? "none" : list_names(layout.header().fields),
                fmt::join(names_of(wanted), ",")));
    }
}

/// The stop field that the options name, and the tightest sound bound that the store has.
void choose_fields(const StoreReader& store, const ExtractOptions& options, TraversalQuery& query) {
    switch (options.guarantee) {
        case Guarantee::deviation:
            query.stop = Field::deviation_bar;
            break;
        case Guarantee::plus:
            query.stop = Field::linf_plus;
            break;
        case Guarantee::estimate:
            query.stop = Field::linf_bar;
            break;
    }
    query.stop = options.stop.value_or(query.stop);
    require(store, query.stop, options.stop ? "--stop" : "this --guarantee");
    if (options.bound) {
        if (!is_bound(*options.bound)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--bound {}: this field bounds nothing; deviation_bar, "
                                    "deviation_plus, linf_plus and grad_linf_plus do",
                                    name_of(*options.bound)));
        }
        require(store, *options.bound, "--bound");
        query.bound = *options.bound;
        return;
    }
    if (!query.plane && !options.graph_scale) {
        const std::optional<Field> tightest = store.layout().tightest_bound();
        query.bound = tightest.value_or(Field::deviation_bar);
        require(store, query.bound, "the search for the surface");
    } else {
        query.bound = store.layout().tightest_bound().value_or(query.stop);  // not used
    }
}

/// Triangles have isolines and a graph, tetrahedra surfaces and slices.
void require_dimension(const StoreReader& store, const std::filesystem::path& mesh,
                       const ExtractOptions& options) {
    const Int3 n = store.layout().lattice().nodes();
    const int dimension = store.layout().lattice().dimension();
    const auto refuse = [&](const char* what) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{}: {} x {} x {} nodes: {}", store.path().string(), n.x, n.y, n.z, what));
    };
    if (dimension == 3 && options.graph_scale) {
        refuse("--graph needs data in a plane, one node along z");
    }
    if (dimension == 2 && options.plane) {
        refuse("a slice needs a volume; draw data in a plane with extract --graph --scale 0");
    }
    if (dimension == 2 && options.view) {
        refuse("--view needs a volume");
    }
    if (dimension == 2 && options.graph_scale && n.z != 1) {
        refuse("--graph needs data in the xy plane, one node along z");
    }
    if (options.graph_scale && !std::isfinite(*options.graph_scale)) {
        throw Error(ErrorKind::invalid_argument, "--scale: must be a finite number");
    }
    if ((dimension == 2 && !options.graph_scale) || !options.contours.empty()) {
        require_lines(mesh);
    }
}

double largest_of(const StoreReader& store, Field field) {
    double largest = 0;
    for (const ArrayInfo& array : store.layout().arrays()) {
        for (std::int64_t i = 0; array.field == field && i < array.grid.product(); ++i) {
            const double max = store.row(array, array.grid.unlinear(i)).max;
            largest = std::isfinite(max) ? std::max(largest, max) : largest;
        }
    }
    return largest;
}

double threshold_of(const StoreReader& store, const ExtractOptions& options) {
    if (!options.stop) {
        return tolerance_of(store, options);
    }
    if (options.error || options.error_relative) {
        throw Error(ErrorKind::invalid_argument,
                    "give either --error or --stop with --threshold, not both");
    }
    if (!(options.threshold >= 0) || !std::isfinite(options.threshold)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("threshold {}: must be a finite number >= 0", options.threshold));
    }
    return options.threshold *
           (options.threshold_relative ? largest_of(store, *options.stop) : 1.0);
}

void choose_culling(const StoreReader& store, const ExtractOptions& options,
                    TraversalQuery& query) {
    if (!options.view) {
        return;
    }
    const Double3& v = *options.view;
    if (!(std::hypot(v[0], v[1], v[2]) > 0) || !std::isfinite(v[0] + v[1] + v[2])) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("view {},{},{}: give a direction, not zero", v[0], v[1], v[2]));
    }
    const bool by_normal = store.layout().has(Field::normal_turn_plus);
    const Field field =
        options.cull_by.value_or(by_normal ? Field::normal_turn_plus : Field::grad_linf_plus);
    if (field != Field::normal_turn_plus && field != Field::grad_linf_plus) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("--cull-by {}: give normal_turn_plus or grad_linf_plus", name_of(field)));
    }
    require(store, field, "--view");
    query.culling.emplace(v, field, store.layout().header().spacing);
}

void choose_attributes(const StoreReader& store, const std::filesystem::path& mesh,
                       const ExtractOptions& options, TraversalQuery& query) {
    query.attributes.normal = options.normals;
    query.attributes.value = options.values != nullptr || options.plane.has_value();
    // Contours are found among the values, whatever the lines' format holds.
    const bool room = holds_float64(mesh_format_of(mesh)) || !options.contours.empty();
    query.attributes.wide_value =
        query.attributes.value && room &&
        !held_by_float32(options.values != nullptr ? *options.values : store);
    query.attributes.error = options.vertex_error;
    if (options.vertex_error) {
        require(store, *options.vertex_error, "--vertex-error");
    }
    if (options.values != nullptr &&
        options.values->layout().header().nodes != store.layout().header().nodes) {
        const Int3 a = store.layout().header().nodes;
        const Int3 b = options.values->layout().header().nodes;
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}: has {} x {} x {} nodes, {} has {} x {} x {}; vertex values "
                                "need the same lattice",
                                options.values->path().string(), b.x, b.y, b.z,
                                store.path().string(), a.x, a.y, a.z));
    }
}

/// In lattice coordinates, its normal so that something lies strictly below the plane where the
/// plane touches the volume: a slice along the volume's border then is not empty.
std::optional<LatticePlane> lattice_plane(const StoreReader& store, const ExtractOptions& options) {
    if (!options.plane) {
        return {};
    }
    const WorldPlane& world = *options.plane;
    const StoreHeader& header = store.layout().header();
    LatticePlane plane;
    plane.offset = world.offset;
    double size = 0;
    double low = 0;  // of n . p over the volume
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        plane.normal[a] = world.normal[a] * header.spacing[a];
        plane.offset -= world.normal[a] * header.origin[a];
        size += std::fabs(world.normal[a]);
        low += std::min(0.0, plane.normal[a] * static_cast<double>(header.nodes[axis] - 1));
    }
    if (!(size > 0) || !std::isfinite(size) || !std::isfinite(world.offset)) {
        throw Error(ErrorKind::invalid_argument,
                    "plane: the normal must be finite and not zero, the offset finite");
    }
    if (low >= plane.offset) {
        for (double& n : plane.normal) {
            n = -n;
        }
        plane.offset = -plane.offset;
    }
    return plane;
}

void require_contours(const ExtractOptions& options) {
    if (options.contours.empty()) {
        return;
    }
    if (!options.plane) {
        throw Error(ErrorKind::invalid_argument, "contours: only of a slice");
    }
    if (options.normals || options.vertex_error) {
        throw Error(ErrorKind::invalid_argument,
                    "contours: lines carry their value, no normals and no --vertex-error");
    }
    if (options.contours.size() > kMostContours) {
        throw Error(ErrorKind::limit, fmt::format("contours: {} values; at most {} at once",
                                                  options.contours.size(), kMostContours));
    }
    for (const double value : options.contours) {
        if (!std::isfinite(value)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("contours: {}: must be a finite number", value));
        }
    }
}

ClipBox clip_box(const StoreReader& store, const std::optional<WorldBox>& box) {
    const StoreHeader& header = store.layout().header();
    ClipBox clip;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        clip.hi[a] = static_cast<double>(header.nodes[axis] - 1);
        if (!box) {
            continue;
        }
        if (!(box->lo[a] < box->hi[a])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("box: {} to {} along {} is empty; give x0,y0,z0,x1,y1,z1 with "
                                    "the low corner first",
                                    box->lo[a], box->hi[a], "xyz"[a]));
        }
        clip.lo[a] = std::max(clip.lo[a], (box->lo[a] - header.origin[a]) / header.spacing[a]);
        clip.hi[a] = std::min(clip.hi[a], (box->hi[a] - header.origin[a]) / header.spacing[a]);
    }
    return clip;
}

/// A slice along an axis within the box is not to be cut along that axis: what lies in the box's
/// own face would be lost.
void keep_on_border(TraversalQuery& query) {
    for (std::size_t axis = 0; axis < 3 && query.plane; ++axis) {
        const Double3& n = query.plane->normal;
        if (n[(axis + 1) % 3] != 0 || n[(axis + 2) % 3] != 0) {
            continue;
        }
        const double at = query.plane->offset / n[axis];
        if (at >= query.box.lo[axis] && at <= query.box.hi[axis]) {
            query.box.lo[axis] = -kInfinity;
            query.box.hi[axis] = kInfinity;
        }
    }
}

/// What a mesh holds is float32.
void require_float32(const StoreReader& store, double number, const std::string& what,
                     const char* way_out) {
    constexpr float kLargest = std::numeric_limits<float>::max();
    if (!(std::fabs(number) <= kLargest)) {
        throw Error(ErrorKind::limit,
                    fmt::format("{}: {} {:.6g}, and a mesh's 32-bit floats end at {:.6g}: {}",
                                store.path().string(), what, number, kLargest, way_out));
    }
}

/// Both ends of what the values reach; 0 where all are missing.
std::array<double, 2> value_range(const StoreReader& store) {
    if (!(store.min_value() <= store.max_value())) {
        return {0, 0};
    }
    return {store.min_value(), store.max_value()};
}

/// REQUIRES: world coordinates within float32.
double coordinate_rounding(const StoreHeader& header) {
    double most = 0;
    const Double3 last = last_position(header);
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto largest =
            static_cast<float>(std::max(std::fabs(header.origin[a]), std::fabs(last[a])));
        const double next = std::nextafter(largest, 0.0F);
        if (header.nodes[axis] > 1) {
            most = std::max(most, (largest - next) / 2 / header.spacing[a]);
        }
    }
    return most;
}

void require_float32(const StoreReader& store, const ExtractOptions& options,
                     const ExtractQuery& query) {
    const Int3 nodes = store.layout().header().nodes;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const bool graph = axis == 2 && options.graph_scale;
        const auto ends =
            graph ? value_range(store) : std::array{0.0, static_cast<double>(nodes[axis] - 1)};
        for (const double end : ends) {
            require_float32(store, query.origin[a] + query.spacing[a] * end,
                            fmt::format("the volume reaches {} =", "xyz"[a]),
                            graph ? "give another --scale"
                                  : "preprocess it again with another --spacing or --origin");
        }
    }
    if (query.traversal.attributes.value && !query.traversal.attributes.wide_value) {
        const StoreReader& values = options.values != nullptr ? *options.values : store;
        for (const double end : value_range(values)) {
            require_float32(values, end, "values reach", "scale the data before preprocessing");
        }
    }
}

}  // namespace

ExtractQuery extract_query(const StoreReader& store, const std::filesystem::path& mesh,
                           const ExtractOptions& options) {
    require_dimension(store, mesh, options);
    require_contours(options);
    if (!options.plane && !options.graph_scale && !std::isfinite(options.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", options.iso));
    }
    static_cast<void>(mesh_format_of(mesh));
    const StoreHeader& header = store.layout().header();
    ExtractQuery asked;
    asked.spacing = header.spacing;
    asked.origin = header.origin;
    TraversalQuery& query = asked.traversal;
    query.iso = options.iso;
    query.plane = lattice_plane(store, options);
    choose_fields(store, options, query);
    asked.threshold = threshold_of(store, options);
    query.tolerance =
        Tolerance(asked.threshold, options.focus, options.camera, header.spacing, header.origin);
    choose_culling(store, options, query);
    choose_attributes(store, mesh, options, query);
    query.box = clip_box(store, options.box);
    keep_on_border(query);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (store.layout().lattice().dimension() == 2 &&
            header.nodes[static_cast<int>(axis)] == 1) {
            query.box.lo[axis] = -kInfinity;
            query.box.hi[axis] = kInfinity;
        }
    }
    if (options.graph_scale) {
        asked.spacing[2] = *options.graph_scale;
        asked.origin[2] = 0;
        query.attributes.graph_scale = options.graph_scale;
    }
    require_float32(store, options, asked);
    asked.coordinate_rounding = coordinate_rounding(header);
    return asked;
}

}  // namespace isonest::detail
