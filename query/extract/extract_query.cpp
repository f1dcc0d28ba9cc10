#include "query/extract/extract_query.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "query/extract/combinations.h"
#include "query/extract/kept_analysis.h"
#include "query/extract/query_checks.h"
#include "query/extract/stages/simplify_stages.h"
#include "query/mesh/vertex_stars.h"
#include "query/slabs/slab_reader.h"
#include "query/values/label_view.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest::detail {
namespace {

Focus turned(const Focus& focus, const StoreHeader& header) {
    Focus out = focus;
    std::tie(out.lo, out.hi) = bounds_of_box(focus.lo, focus.hi, [&](const Double3& p) {
        return unrotated_about(header.origin, header.rotation(), p);
    });
    return out;
}

void require_no_box(const std::optional<WorldBox>& box, const std::string& name) {
    if (box) {
        throw Error(ErrorKind::unsupported, {name},
                    "a box needs a volume whose axes are along the world's; crop the volume when "
                    "it is preprocessed",
                    {{RemedyKind::leave_out, "box"}});
    }
}

/// Common part of surfaces of values, slices and contours.
template <class Query>
Query with_places(Query query, const StoreHeader& header, const std::string& name) {
    require_no_box(query.box, name);
    if (query.focus) {
        query.focus = turned(*query.focus, header);
    }
    if (query.camera) {
        query.camera->position =
            unrotated_about(header.origin, header.rotation(), query.camera->position);
    }
    return query;
}

}  // namespace

WorldPlane in_own_axes(const WorldPlane& plane, const StoreHeader& header) {
    WorldPlane own;
    own.normal = unrotated(header.rotation(), plane.normal);
    own.offset = plane.offset - dot(plane.normal, header.origin) + dot(own.normal, header.origin);
    return own;
}

SurfaceQuery in_own_axes(SurfaceQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(std::move(query), header, name);
    if (auto& culling = query.grid.culling) {
        culling->direction = unrotated(header.rotation(), culling->direction);
    }
    return query;
}
LabelQuery in_own_axes(LabelQuery query, const StoreHeader& /*header*/, const std::string& name) {
    require_no_box(query.box, name);
    return query;
}
SliceQuery in_own_axes(SliceQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(query, header, name);
    query.plane = in_own_axes(query.plane, header);
    return query;
}
ContourQuery in_own_axes(ContourQuery query, const StoreHeader& header, const std::string& name) {
    query = with_places(std::move(query), header, name);
    query.plane = in_own_axes(query.plane, header);
    return query;
}
GraphQuery in_own_axes(const GraphQuery& /*query*/, const StoreHeader& /*header*/,
                       const std::string& name) {
    throw Error(ErrorKind::unsupported, {name},
                "a graph needs axes along the world's; preprocess the data without directions",
                {{RemedyKind::place_in_world, "spacing"}});
}

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The bound of the interest test: the requested one, or the tightest sound one in the store.
Field bound_of(const StoreReader& store, const std::optional<Field>& asked) {
    if (!asked) {
        const Field bound = store.layout().tightest_bound().value_or(Field::deviation_bar);
        require_field(store, bound, "the search for the surface");
        return bound;
    }
    if (!is_bound(*asked)) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format(
                "the field {} is not a bound; use deviation_bar, deviation_plus, linf_plus or "
                "grad_linf_plus",
                name_of(*asked)),
            {{RemedyKind::other_field, "deviation_bar,deviation_plus,linf_plus,grad_linf_plus"}});
    }
    require_field(store, *asked, "this bound");
    return *asked;
}

Culling culling_of(const StoreReader& store, const BackfaceCulling& asked) {
    const Double3& v = asked.direction;
    if (!(hypot3(v[0], v[1], v[2]) > 0) || !std::isfinite(v[0] + v[1] + v[2])) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("view {},{},{}: give a direction, not zero", v[0], v[1], v[2]));
    }
    const bool by_normal = store.layout().has(Field::normal_turn_plus);
    const Field field =
        asked.field.value_or(by_normal ? Field::normal_turn_plus : Field::grad_linf_plus);
    if (field != Field::normal_turn_plus && field != Field::grad_linf_plus) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format(
                "the field {} cannot detect backfaces; use normal_turn_plus or grad_linf_plus",
                name_of(field)),
            {{RemedyKind::other_field, "normal_turn_plus,grad_linf_plus"}});
    }
    require_field(store, field, "leaving out backfaces");
    return {v, field, store.layout().header().steps()};
}

ClipBox clip_box(const StoreHeader& header, const std::optional<WorldBox>& box) {
    const LatticeSteps steps = header.steps();
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
        clip.lo[a] = std::max(clip.lo[a], steps.place(a, box->lo[a] - header.origin[a]));
        clip.hi[a] = std::min(clip.hi[a], steps.place(a, box->hi[a] - header.origin[a]));
    }
    return clip;
}

/// A slice across an axis within the box must not be clipped along that axis: a slice in the box's
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

/// Common part of all queries.
ExtractQuery begun(const StoreReader& store, Product product, const Stop& stop, Cells cells,
                   const std::optional<WorldBox>& box) {
    const StoreHeader& header = store.layout().header();
    ExtractQuery asked;
    asked.product = product;
    asked.steps = header.steps();
    asked.origin = header.origin;
    asked.threshold = stop.threshold;
    asked.tolerance = stop.asked;
    asked.traversal.cells = cells;
    asked.traversal.stop = stop.field;
    // If nothing is searched, the bound is not used.
    asked.traversal.bound = store.layout().tightest_bound().value_or(stop.field);
    asked.traversal.tolerance = Tolerance(stop.threshold, {}, {}, asked.steps, header.origin);
    asked.traversal.box = clip_box(header, box);
    return asked;
}

/// The same for queries with a varying tolerance.
template <class Query>
ExtractQuery begun(const StoreReader& store, Product product, const Query& query, Cells cells,
                   CellField cell_field) {
    const Stop stop = cells == Cells::hexahedra ? stop_of_cells(store, query.stop, cell_field)
                                                : stop_of(store, query.stop);
    ExtractQuery asked = begun(store, product, stop, cells, query.box);
    asked.traversal.tolerance =
        Tolerance(stop.threshold, query.focus, query.camera, asked.steps, asked.origin);
    return asked;
}

/// Chooses the attributes of vertices. `needs_value`: also if no other store gives values.
void choose_attributes(const StoreReader& store, const MeshAttributes& chosen, bool needs_value,
                       bool float64, ExtractQuery& asked) {
    AttributeChoice& attributes = asked.traversal.attributes;
    attributes.normal = chosen.normals;
    attributes.error = chosen.error;
    if (chosen.error) {
        require_numbers(store, "the error at the vertices");
        require_field(store, *chosen.error, "the error at the vertices");
    }
    asked.values = chosen.values != nullptr ? &chosen.values->reader() : nullptr;
    const StoreReader& values = asked.values != nullptr ? *asked.values : store;
    if (asked.values != nullptr) {
        require_numbers(values, "values at the vertices");
    }
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

/// The distances of a surface's stop test: for its simplification and for the traversal.
struct DistanceOfStop {
    const StoreHeader& header;
    Effort effort;
    ExtractQuery& asked;

    void operator()(const DistanceBound& stop) const {
        const double distance = world_distance(header, stop);
        if (effort != Effort::none) {
            asked.stages.distance = distance_choice(header, stop, effort);
        } else if (distance > 0) {
            asked.nested_distance = distance;
            asked.traversal.vertices = VertexPlace::exact;
        }
    }
    void operator()(const TriangleBudgetByDistance& stop) const {
        asked.stages.distance = distance_choice(header, stop, effort);
    }
    template <class Other>
    void operator()(const Other& /*stop*/) const {}
};

void choose_stages(const SurfaceStages& stages, ExtractQuery& asked) {
    asked.traversal.box.close = stages.close;
    if (stages.components) {
        require_components(*stages.components);
        asked.stages.components = stages.components;
    }
}

/// Sets the isovalue between the label and the others, and the part of the volume that contains it.
void choose_label(const StoreReader& store, const LabelChoice& label, ExtractQuery& asked) {
    const StoreHeader& header = store.layout().header();
    require_label(store, label.id);
    constexpr double kHalf = 0.5;
    asked.traversal.iso = kHalf;
    asked.label = label;
    const Int3 last = header.nodes - Int3{1, 1, 1};
    if (!label.within) {
        asked.label->within = {Int3{}, last};
        return;
    }
    const auto& [low, high] = *asked.label->within;
    asked.asked_box = asked.traversal.box;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        ClipBox& box = asked.traversal.box;
        const bool reached = box.lo[a] < static_cast<double>(high[axis] + 1) &&
                             box.hi[a] > static_cast<double>(low[axis] - 1);
        if (reached) {
            box.lo[a] = std::max(box.lo[a], static_cast<double>(low[axis] - 1));
            box.hi[a] = std::min(box.hi[a], static_cast<double>(high[axis] + 1));
        }
    }
}

/// Sets how vertices are rounded and separated.
void choose_apart(const StoreHeader& header, ExtractQuery& asked) {
    asked.coordinate_rounding = coordinate_rounding(header.nodes, asked.steps, asked.origin);
    if (const Directions rotation = header.rotation(); rotation != kAlongWorld) {
        asked.rotation = Rotation{header.origin, rotation};
        asked.min_apart =
            std::max(kMinApart, asked.rotation->min_step(header.nodes, header.steps()));
    }
    asked.moves_apart = is_short_step(step_apart(asked.coordinate_rounding, asked.min_apart));
}

ExtractQuery finished(const StoreReader& store, ExtractQuery asked) {
    keep_on_border(store, asked.traversal);
    require_float32(store, asked);
    choose_apart(store.layout().header(), asked);
    return asked;
}

}  // namespace

double MeshPlace::max_moved() const {
    const LatticeSteps& steps = lattice.steps;
    return steps.is_sheared() ? rounding * steps.diagonal()
                              : std::sqrt(3.0) * rounding * steps.longest();
}

PatchBox MeshPlace::faces_of(const ClipBox& of) const {
    constexpr double kMore = 4;
    return box_faces(of.lo, of.hi, lattice.steps, lattice.origin, kMore * max_moved());
}

MeshPlace mesh_place(const ExtractQuery& query, const Int3& nodes) {
    return {{query.origin, query.steps, nodes},
            query.asked_box.value_or(query.traversal.box),
            query.coordinate_rounding};
}

MemoryShare memory_of(const ExtractOptions& options, const std::string& name) {
    return {name, options.memory, Workers::count_of(options.threads)};
}

double world_distance(const StoreHeader& header, const DistanceBound& asked) {
    const Double3 spacing = header.uneven ? header.steps().min_along() : header.spacing;
    double voxel = kInfinity;
    for (int axis = 0; axis < 3; ++axis) {
        if (header.nodes[axis] > 1) {
            voxel = std::min(voxel, spacing[static_cast<std::size_t>(axis)]);
        }
    }
    return asked.voxels && std::isfinite(voxel) ? asked.value * voxel : asked.value;
}

DistanceChoice distance_choice(const StoreHeader& header, const DistanceStop& stop, Effort effort) {
    if (const auto* const bound = std::get_if<DistanceBound>(&stop)) {
        return {world_distance(header, *bound), std::nullopt, effort};
    }
    const auto& budget = std::get<TriangleBudgetByDistance>(stop);
    const double most = diagonal_of(header);
    const double within = budget.within ? world_distance(header, *budget.within) : most;
    return {within, budget.most, effort, within >= most};
}

double distance_left(const std::string& name, double distance, double moved) {
    if (!(distance > moved)) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("32-bit floats round coordinates so far from 0 by up to {:.3g}, "
                                "more than the distance {:.3g} allows",
                                moved, distance));
    }
    return distance - moved;
}

ExtractQuery extract_query(const StoreReader& store, const SurfaceQuery& query, bool float64) {
    const Features features = features_of(store, query);
    require_combination(features, store.path().string());
    const Cells cells = cells_of(features);
    const bool flat = store.layout().lattice().dimension() == 2;
    if (!std::isfinite(query.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", query.iso));
    }
    if (store.layout().header().labels) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "its values are 64-bit labels, which have no isosurfaces; extract the surface "
                    "of a label");
    }
    const NestedGrid& grid = query.grid;
    require_simplifiable(query.effort, !is_full_resolution(query.stop));
    const Effort effort = effort_of(features);
    // Hexahedra are simplified from the surface at full resolution.
    ExtractQuery asked =
        begun(store, flat ? Product::isolines : Product::surface, query, cells,
              effort == Effort::none ? CellField::needed_by_errors : CellField::not_needed);
    asked.traversal.iso = query.iso;
    asked.traversal.vertices = grid.vertices;
    if (cells == Cells::tetrahedra) {
        asked.traversal.bound = bound_of(store, grid.bound);
    }
    if (grid.culling) {
        asked.traversal.culling = culling_of(store, *grid.culling);
    }
    std::visit(DistanceOfStop{store.layout().header(), effort, asked}, query.stop);
    if (std::holds_alternative<ErrorBound>(query.stop) && effort != Effort::none) {
        if (asked.threshold > 0) {
            asked.stages.error = asked.threshold;
            asked.stages.error_effort = effort;
        }
        // Hexahedra are simplified from full resolution. So are surfaces of volumes with uneven
        // axes: the error of a coarser triangle is that of its image in the lattice, which is bent.
        const double share = cells == Cells::hexahedra || asked.steps.uneven != nullptr
                                 ? 0
                                 : nested_share(grid.vertices);
        asked.traversal.tolerance =
            Tolerance(share * asked.threshold, {}, {}, asked.steps, asked.origin);
    }
    if (query.analysis) {
        asked.analysis_folder =
            query.analysis->folder.empty() ? analysis_folder_of(store) : query.analysis->folder;
    }
    choose_stages(query.stages, asked);
    choose_attributes(store, query.attributes, false, float64, asked);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const VolumeDescription& volume, const SurfaceQuery& query) {
    const Features features = features_of(volume, query);
    require_combination(features, volume.name);
    if (needs_store(volume, query)) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    "errors, fields, several resolutions and vertex values need a store; directly "
                    "from a volume, a surface can be extracted at full resolution, or simplified "
                    "within a distance or to a number of triangles",
                    {{RemedyKind::make_store}});
    }
    require_marchable(volume, query.iso);
    require_distance(query.stop);
    require_simplifiable(query.effort, !is_full_resolution(query.stop));
    ExtractQuery asked;
    asked.steps = header_of(volume).steps();
    asked.origin = volume.origin;
    asked.traversal.iso = query.iso;
    asked.traversal.cells = cells_of(features);
    asked.traversal.stop =
        asked.traversal.cells == Cells::hexahedra ? Field::hex_deviation : Field::deviation_bar;
    asked.traversal.tolerance = Tolerance(0, {}, {}, asked.steps, volume.origin);
    asked.traversal.attributes.normal = query.attributes.normals;
    asked.traversal.box = clip_box(header_of(volume), query.box);
    std::visit(DistanceOfStop{header_of(volume), effort_of(features), asked}, query.stop);
    choose_stages(query.stages, asked);
    choose_apart(header_of(volume), asked);
    return asked;
}

ExtractQuery extract_query(const StoreReader& store, const LabelQuery& query, bool float64) {
    const Features features = features_of(store, query);
    require_combination(features, store.path().string());
    require_simplifiable(query.effort, query.stop.has_value());
    const SurfaceStop stop =
        query.stop ? std::visit([](const auto& s) { return SurfaceStop(s); }, *query.stop)
                   : SurfaceStop();
    const Cells cells = cells_of(features);
    const bool has_cells = cells == Cells::hexahedra;
    ExtractQuery asked =
        begun(store, Product::surface,
              has_cells ? stop_of_cells(store, stop, CellField::not_needed) : stop_of(store, stop),
              cells, query.box);
    if (!has_cells) {
        asked.traversal.bound = bound_of(store, {});
    }
    std::visit(DistanceOfStop{store.layout().header(), effort_of(features), asked}, stop);
    choose_label(store, query.label, asked);
    choose_stages(query.stages, asked);
    choose_attributes(store, query.attributes, false, float64, asked);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64) {
    require_numbers(store, "a slice");
    require_volume(store);
    require_combination(features_of(query), store.path().string());
    ExtractQuery asked = begun(store, Product::slice, query, query.cells, CellField::needed);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    choose_attributes(store, query.attributes, true, float64, asked);
    // The orientation of triangles: towards the smaller distance from the plane.
    Double3& facing = asked.traversal.attributes.plane_normal.emplace();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        facing[axis] = 0 - asked.traversal.plane->normal[axis] / asked.steps.along[axis];
    }
    facing = asked.steps.gradient(facing);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool /*float64*/) {
    require_numbers(store, "contour lines");
    require_volume(store);
    require_contours(query.values);
    ExtractQuery asked =
        begun(store, Product::contours, query, Cells::tetrahedra, CellField::needed);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    asked.contours = query.values;
    // Contours are found among the exact values, independent of the precision of the lines' sink.
    asked.traversal.attributes.value = true;
    asked.traversal.attributes.wide_value = !held_by_float32(store);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64) {
    require_numbers(store, "a graph");
    require_plane(store);
    require_combination(features_of(query), store.path().string());
    require_even_axes(store.layout().header().uneven, store.path().string(), "a graph");
    if (!std::isfinite(query.scale)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("scale {}: must be a finite number", query.scale));
    }
    ExtractQuery asked =
        begun(store, Product::graph, query, query.cells, CellField::needed_by_errors);
    asked.steps.along[2] = query.scale;
    asked.origin[2] = 0;
    asked.graph_scale = query.scale;
    asked.traversal.attributes.graph_scale = query.scale;
    choose_attributes(store, query.attributes, false, float64, asked);
    return finished(store, std::move(asked));
}

}  // namespace isonest::detail

namespace isonest {

LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label) {
    using detail::Feature;
    detail::Features features = detail::features_of(like);
    features.set(static_cast<std::size_t>(Feature::label));
    detail::require_combination(features, {});
    LabelQuery query;
    query.label = label;
    if (const auto* const distance = std::get_if<DistanceBound>(&like.stop)) {
        query.stop = *distance;
    } else if (const auto* const budget = std::get_if<TriangleBudgetByDistance>(&like.stop)) {
        query.stop = *budget;
    }
    query.effort = like.effort;
    query.box = like.box;
    query.cells = like.grid.cells;
    query.attributes = like.attributes;
    query.stages = like.stages;
    return query;
}

}  // namespace isonest
