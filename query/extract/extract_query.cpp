#include "query/extract/extract_query.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "query/extract/kept_analysis.h"
#include "query/extract/label_query.h"
#include "query/extract/query_checks.h"
#include "query/extract/value_simplification.h"
#include "store/container/extent.h"

namespace isonest::detail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The bound of the interest test: the one asked for, or the tightest sound one that there is.
Field bound_of(const StoreReader& store, const std::optional<Field>& asked) {
    if (!asked) {
        const Field bound = store.layout().tightest_bound().value_or(Field::deviation_bar);
        require_field(store, bound, "the search for the surface");
        return bound;
    }
    if (!is_bound(*asked)) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("the field {} bounds nothing; deviation_bar, deviation_plus, "
                        "linf_plus and grad_linf_plus do",
                        name_of(*asked)),
            {{RemedyKind::other_field, "deviation_bar,deviation_plus,linf_plus,grad_linf_plus"}});
    }
    require_field(store, *asked, "this bound");
    return *asked;
}

Culling culling_of(const StoreReader& store, const BackfaceCulling& asked) {
    const Double3& v = asked.direction;
    if (!(std::hypot(v[0], v[1], v[2]) > 0) || !std::isfinite(v[0] + v[1] + v[2])) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("view {},{},{}: give a direction, not zero", v[0], v[1], v[2]));
    }
    const bool by_normal = store.layout().has(Field::normal_turn_plus);
    const Field field =
        asked.field.value_or(by_normal ? Field::normal_turn_plus : Field::grad_linf_plus);
    if (field != Field::normal_turn_plus && field != Field::grad_linf_plus) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("the field {} shows no backfaces; normal_turn_plus and "
                                "grad_linf_plus do",
                                name_of(field)),
                    {{RemedyKind::other_field, "normal_turn_plus,grad_linf_plus"}});
    }
    require_field(store, field, "leaving out backfaces");
    return {v, field, store.layout().header().spacing};
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
                        fmt::format("box: {} to {} along {} is empty; the low corner "
                                    "comes first",
                                    box->lo[a], box->hi[a], "xyz"[a]));
        }
        clip.lo[a] = std::max(clip.lo[a], (box->lo[a] - header.origin[a]) / header.spacing[a]);
        clip.hi[a] = std::min(clip.hi[a], (box->hi[a] - header.origin[a]) / header.spacing[a]);
    }
    return clip;
}

/// A slice along an axis within the box is not to be cut along that axis: what lies in the box's
/// own face would be lost. Data in a plane have no extent along their flat axis.
void keep_on_border(const StoreReader& store, TraversalQuery& query) {
    const Lattice& lattice = store.layout().lattice();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        bool keep = lattice.dimension() == 2 && lattice.nodes()[static_cast<int>(axis)] == 1;
        if (query.plane) {
            const Double3& n = query.plane->normal;
            const double at = query.plane->offset / n[axis];
            keep = keep || (n[(axis + 1) % 3] == 0 && n[(axis + 2) % 3] == 0 &&
                            at >= query.box.lo[axis] && at <= query.box.hi[axis]);
        }
        if (keep) {
            query.box.lo[axis] = -kInfinity;
            query.box.hi[axis] = kInfinity;
        }
    }
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

/// What all queries have.
template <class Query>
ExtractQuery begun(const StoreReader& store, Product product, const Query& query) {
    const StoreHeader& header = store.layout().header();
    ExtractQuery asked;
    asked.product = product;
    asked.spacing = header.spacing;
    asked.origin = header.origin;
    const Stop stop = [&] {
        if constexpr (requires { query.cells; }) {
            if (query.cells == Cells::hexahedra) {
                asked.traversal.cells = query.cells;
                return stop_of_cells(store, query);
            }
        }
        return stop_of(store, query.stop);
    }();
    asked.threshold = stop.threshold;
    asked.traversal.stop = stop.field;
    // Where nothing is searched the bound is not used.
    asked.traversal.bound = store.layout().tightest_bound().value_or(stop.field);
    asked.traversal.tolerance =
        Tolerance(stop.threshold, query.focus, query.camera, header.spacing, header.origin);
    asked.traversal.box = clip_box(store, query.box);
    return asked;
}

/// What the vertices carry. `needs_value`: also if no other store gives values.
template <class Query>
void choose_attributes(const StoreReader& store, const Query& query, bool needs_value, bool float64,
                       ExtractQuery& asked) {
    AttributeChoice& attributes = asked.traversal.attributes;
    attributes.normal = query.normals;
    attributes.error = query.vertex_error;
    if (query.vertex_error) {
        require_field(store, *query.vertex_error, "the error at the vertices");
    }
    asked.values = query.vertex_values != nullptr ? &query.vertex_values->reader() : nullptr;
    const StoreReader& values = asked.values != nullptr ? *asked.values : store;
    attributes.value = needs_value || asked.values != nullptr;
    attributes.wide_value = attributes.value && float64 && !held_by_float32(values);
    const Int3 a = store.layout().header().nodes;
    const Int3 b = values.layout().header().nodes;
    if (a != b) {
        throw Error(ErrorKind::invalid_argument, {values.path().string()},
                    fmt::format("has {} x {} x {} nodes, {} has {} x {} x {}; vertex values need "
                                "the same lattice",
                                b.x, b.y, b.z, store.path().string(), a.x, a.y, a.z));
    }
}

/// A distance is the same everywhere.
void require_no_place(const SurfaceQuery& query) {
    if (query.focus || query.camera) {
        throw Error(ErrorKind::invalid_argument,
                    "a distance holds everywhere: it goes with neither focus nor camera");
    }
}

/// The error within which the surface is simplified; nothing if that is 0.
std::optional<double> value_limit(const StoreReader& store, const SurfaceQuery& query, double error,
                                  bool flat) {
    const ErrorBound& bound = std::get<SimplifiedErrorBound>(query.stop).bound;
    if (flat) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "isolines are not simplified within an error; ask for a distance");
    }
    if (query.focus || query.camera) {
        throw Error(ErrorKind::invalid_argument,
                    "a surface is simplified within one error everywhere: it goes with neither "
                    "focus nor camera");
    }
    if (bound.guarantee == Guarantee::estimate) {
        throw Error(ErrorKind::invalid_argument,
                    "an estimate proves nothing about the triangles of a simplified surface; the "
                    "other guarantees do");
    }
    return error > 0 ? std::optional(error) : std::nullopt;
}

double world_distance(const StoreReader& store, const DistanceBound& asked) {
    const StoreHeader& header = store.layout().header();
    double voxel = kInfinity;
    for (int axis = 0; axis < 3; ++axis) {
        if (header.nodes[axis] > 1) {
            voxel = std::min(voxel, header.spacing[static_cast<std::size_t>(axis)]);
        }
    }
    return asked.voxels && std::isfinite(voxel) ? asked.value * voxel : asked.value;
}

void require_nested_distance(const StoreReader& store, const SurfaceQuery& query, bool flat) {
    require_no_place(query);
    const auto refuse = [&](const char* what) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    fmt::format("{}; simplified, a distance goes with it", what));
    };
    if (flat) {
        refuse("isolines have no nested grid within a distance");
    }
    if (query.close) {
        refuse("caps are cut out of linear functions, not of a nested grid within a distance");
    }
    if (query.components) {
        refuse("components are those of the full surface, which a nested grid does not know");
    }
    if (query.culling) {
        throw Error(ErrorKind::invalid_argument,
                    "a distance is from the whole surface, not from what a viewer sees of it");
    }
}

void require_analysable(const StoreReader& store, const SurfaceQuery& query, bool flat) {
    if (flat) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "analyses are kept of surfaces; lines are simplified fast enough without");
    }
    if (!std::holds_alternative<DistanceBound>(query.stop) &&
        !std::holds_alternative<TriangleBudget>(query.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "an analysis is kept for a distance or a number of triangles; ask for one");
    }
    if (query.culling) {
        throw Error(ErrorKind::invalid_argument,
                    "an analysis is kept of a whole surface, not of what a viewer sees of it");
    }
}

void require_place_of_vertices(const SurfaceQuery& query) {
    if (query.close) {
        throw Error(ErrorKind::invalid_argument,
                    "caps are cut out of linear functions: a closed surface has linear vertices, "
                    "or, at full resolution and within a distance, exact ones in any case");
    }
    if (std::holds_alternative<DistanceBound>(query.stop) ||
        std::holds_alternative<TriangleBudget>(query.stop)) {
        throw Error(ErrorKind::invalid_argument,
                    "within a distance all vertices lie on the surface at full resolution in any "
                    "case");
    }
}

void require_closable(const StoreReader& store, const SurfaceQuery& query) {
    if (store.layout().lattice().dimension() < 3) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "closing needs a volume, with more than one node along each axis");
    }
    if (query.culling) {
        throw Error(ErrorKind::invalid_argument,
                    "a surface is open where its backfaces are left out: it cannot be closed and "
                    "culled");
    }
}

void require_sense(const ComponentChoice& choice, Product product) {
    if (!(choice.least_volume >= 0) || !std::isfinite(choice.least_volume)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("least volume {}: must be a finite number, 0 or more",
                                choice.least_volume));
    }
    if (choice.least_volume > 0 && product == Product::isolines) {
        throw Error(ErrorKind::invalid_argument,
                    "isolines of data in a plane have no volume; give the least number of lines");
    }
}

ExtractQuery finished(const StoreReader& store, ExtractQuery asked) {
    keep_on_border(store, asked.traversal);
    require_float32(store, asked);
    asked.coordinate_rounding = coordinate_rounding(store.layout().header());
    return asked;
}

}  // namespace

ExtractQuery extract_query(const StoreReader& store, const SurfaceQuery& query, bool float64) {
    const bool flat = store.layout().lattice().dimension() == 2;
    const Product product = flat ? Product::isolines : Product::surface;
    require_dimension(store, product, query.culling.has_value());
    if (query.close) {
        require_closable(store, query);
    }
    if (!std::isfinite(query.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", query.iso));
    }
    if (store.layout().header().labels && !query.label) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "its values are labels of 64 bits: a surface is that of a label");
    }
    ExtractQuery asked = begun(store, product, query);
    asked.traversal.iso = query.iso;
    asked.traversal.box.close = query.close;
    if (query.cells == Cells::tetrahedra) {
        asked.traversal.bound = bound_of(store, query.bound);
    }
    if (query.culling) {
        asked.traversal.culling = culling_of(store, *query.culling);
    }
    if (const auto* const distance = std::get_if<DistanceBound>(&query.stop)) {
        require_no_place(query);
        asked.distance = world_distance(store, *distance);
    } else if (const auto* const budget = std::get_if<TriangleBudget>(&query.stop)) {
        require_no_place(query);
        if (flat) {
            throw Error(ErrorKind::invalid_argument,
                        "isolines have no triangles; ask for a distance");
        }
        asked.triangles = budget->most;
        asked.distance = budget->within ? world_distance(store, *budget->within)
                                        : diagonal_of(store.layout().header());
    }
    if (std::holds_alternative<SimplifiedErrorBound>(query.stop)) {
        asked.value_limit = value_limit(store, query, asked.threshold, flat);
        asked.traversal.tolerance = Tolerance(nested_share(query.vertices) * asked.threshold, {},
                                              {}, asked.spacing, asked.origin);
    }
    if (const auto* const nested = std::get_if<NestedDistanceBound>(&query.stop)) {
        require_nested_distance(store, query, flat);
        if (const double distance = world_distance(store, nested->bound); distance > 0) {
            asked.nested_distance = distance;
            asked.traversal.vertices = VertexPlace::exact;
        }
    }
    if (query.analysis) {
        require_analysable(store, query, flat);
        asked.analysis_folder =
            query.analysis->folder.empty() ? folder_of(store.path()) : query.analysis->folder;
    }
    if (query.vertices == VertexPlace::exact) {
        require_place_of_vertices(query);
        asked.traversal.vertices = query.vertices;
    }
    if (query.label) {
        choose_label(store, query, asked);
    }
    if (query.components) {
        require_sense(*query.components, product);
        asked.components = query.components;
    }
    choose_attributes(store, query, false, float64, asked);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64) {
    require_dimension(store, Product::slice, false);
    ExtractQuery asked = begun(store, Product::slice, query);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    choose_attributes(store, query, true, float64, asked);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool /*float64*/) {
    require_dimension(store, Product::contours, false);
    require_contours(query.values);
    ExtractQuery asked = begun(store, Product::contours, query);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    asked.contours = query.values;
    // Contours are found among the values, whatever the lines' sink holds.
    asked.traversal.attributes.value = true;
    asked.traversal.attributes.wide_value = !held_by_float32(store);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64) {
    require_dimension(store, Product::graph, false);
    if (!std::isfinite(query.scale)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("scale {}: must be a finite number", query.scale));
    }
    ExtractQuery asked = begun(store, Product::graph, query);
    asked.spacing[2] = query.scale;
    asked.origin[2] = 0;
    asked.graph_scale = query.scale;
    asked.traversal.attributes.graph_scale = query.scale;
    choose_attributes(store, query, false, float64, asked);
    return finished(store, std::move(asked));
}

}  // namespace isonest::detail
