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
WorldPlane in_own_axes(const WorldPlane& plane, const StoreHeader& header) {
    WorldPlane own;
    own.normal = unrotated(header.rotation(), plane.normal);
    own.offset = plane.offset - dot(plane.normal, header.origin) + dot(own.normal, header.origin);
    return own;
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

/// `v`: the direction, in the volume's own axes.
Culling culling_of(const StoreReader& store, const BackfaceCulling& asked, const Double3& v) {
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

/// The stop of a query with these cells.
template <class StopTest>
Stop stop_for(const StoreReader& store, const StopTest& test, Cells cells, CellField cell_field) {
    return cells == Cells::hexahedra ? stop_of_cells(store, test, cell_field)
                                     : stop_of(store, test);
}

/// A query that is being made, in the axes of its volume.
class Asking {
  public:
    /// `name`: of the store or volume. Throws Error{unsupported} for a box if the axes are not
    /// those of the world.
    Asking(const StoreHeader& header, const std::string& name, const std::optional<WorldBox>& box)
        : header_(header), box_(box), is_along_world_(header.direction == kAlongWorld) {
        if (box && !is_along_world_) {
            throw Error(ErrorKind::unsupported, {name},
                        "a box needs a volume whose axes are along the world's; crop the volume "
                        "when it is preprocessed",
                        {{RemedyKind::leave_out, "box"}});
        }
        if (box) {
            require_not_curved(header, name, "a box");
        }
    }
    Asking(const StoreReader& store, const std::optional<WorldBox>& box)
        : Asking(store.layout().header(), store.path().string(), box) {}

    ExtractQuery asked;

    /// Common part of all queries, with the same tolerance everywhere.
    void begin(Product product, const Stop& stop, Cells cells) {
        asked.product = product;
        asked.steps = header_.steps();
        asked.origin = header_.origin;
        asked.threshold = stop.threshold;
        asked.tolerance = stop.asked;
        asked.traversal.cells = cells;
        asked.traversal.stop = stop.field;
        asked.traversal.box = clip_box(header_, box_);
        if (header_.curved) {
            place_around(*header_.curved);
        }
        stop_below(stop.threshold);
    }
    void begin(const StoreReader& store, Product product, const Stop& stop, Cells cells) {
        begin(product, stop, cells);
        // If nothing is searched, the bound is not used.
        asked.traversal.bound = store.layout().tightest_bound().value_or(stop.field);
    }
    /// Also with a tolerance that varies.
    void stop_below(double threshold, std::optional<Focus> focus = {},
                    std::optional<Camera> camera = {}) {
        if (focus || camera) {
            require_not_curved(header_, {}, "a focus or camera");
        }
        if (focus && !is_along_world_) {
            std::tie(focus->lo, focus->hi) =
                bounds_of_box(focus->lo, focus->hi, [&](const Double3& p) { return own_place(p); });
        }
        if (camera && !is_along_world_) {
            camera->position = own_place(camera->position);
        }
        asked.traversal.tolerance =
            Tolerance(threshold, focus, camera, header_.steps(), header_.origin);
    }
    void cull(const StoreReader& store, const BackfaceCulling& culling) {
        asked.traversal.culling = culling_of(
            store, culling,
            is_along_world_ ? culling.direction : unrotated(header_.rotation(), culling.direction));
    }
    void cut(const WorldPlane& plane) {
        asked.traversal.plane =
            lattice_plane(header_, is_along_world_ ? plane : in_own_axes(plane, header_));
    }
    /// Chooses the attributes of vertices. `needs_value`: also if no other store gives values.
    void choose_attributes(const StoreReader& store, const MeshAttributes& chosen, bool needs_value,
                           bool float64) {
        AttributeChoice& attributes = asked.traversal.attributes;
        attributes.normal = chosen.normals;
        attributes.error = chosen.error;
        if (chosen.error) {
            require_numbers(store, "the error at the vertices");
            require_field(store, *chosen.error, "the error at the vertices");
        }
        asked.values = chosen.values != nullptr ? &chosen.values->reader() : nullptr;
        const StoreReader& values = asked.values_in(store);
        if (asked.values != nullptr) {
            require_numbers(values, "values at the vertices");
        }
        attributes.value = needs_value || asked.values != nullptr;
        attributes.wide_value = attributes.value && float64 && !held_by_float32(values);
        const Int3 a = header_.nodes;
        const Int3 b = values.layout().header().nodes;
        if (a != b) {
            throw Error(ErrorKind::invalid_argument, {values.path().string()},
                        fmt::format("has {} x {} x {} nodes, {} has {} x {} x {}; vertex values "
                                    "need the same lattice",
                                    b.x, b.y, b.z, store.path().string(), a.x, a.y, a.z));
        }
    }
    /// Chooses the distance of a surface's stop test: for its simplification or for the traversal.
    void choose_distance(const SurfaceStop& stop, Effort effort) {
        const auto* const bound = std::get_if<DistanceBound>(&stop);
        const auto* const budget = std::get_if<TriangleBudgetByDistance>(&stop);
        if (budget != nullptr) {
            asked.stages.distance = distance_choice(header_, *budget, effort);
        } else if (bound != nullptr && effort != Effort::none) {
            asked.stages.distance = distance_choice(header_, *bound, effort);
        } else if (bound != nullptr && world_distance(header_, *bound) > 0) {
            asked.nested_distance = world_distance(header_, *bound);
            asked.traversal.vertices = VertexPlace::exact;
        }
    }
    void choose_stages(const SurfaceStages& stages) {
        asked.traversal.box.close = stages.close;
        asked.stages.manifold = stages.manifold;
        if (stages.components) {
            require_components(*stages.components);
            asked.stages.components = stages.components;
        }
    }
    /// Sets the isovalue between the label and the others, and the part of the volume that contains
    /// it.
    void choose_label(const LabelChoice& label) {
        constexpr double kHalf = 0.5;
        asked.traversal.iso = kHalf;
        asked.label = label;
        if (!label.within) {
            asked.label->within = {Int3{}, header_.nodes - Int3{1, 1, 1}};
            return;
        }
        const auto& [low, high] = *asked.label->within;
        ClipBox& box = asked.traversal.box;
        asked.asked_box = box;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const bool reached = box.lo[a] < static_cast<double>(high[axis] + 1) &&
                                 box.hi[a] > static_cast<double>(low[axis] - 1);
            if (reached) {
                box.lo[a] = std::max(box.lo[a], static_cast<double>(low[axis] - 1));
                box.hi[a] = std::min(box.hi[a], static_cast<double>(high[axis] + 1));
            }
        }
    }
    ExtractQuery finish(const StoreReader& store) {
        if (!asked.traversal.tolerance.is_zero()) {
            // The error of a coarser element is that of its image in the lattice, which is bent.
            require_even_axes(header_, store.path().string(),
                              "the nested grid (an error with the effort none, or of a slice or "
                              "lines)");
        }
        if (asked.stages.error) {
            require_not_curved(header_, store.path().string(), "simplification within an error");
        }
        if (asked.values != nullptr || asked.traversal.attributes.error) {
            require_not_curved(header_, store.path().string(),
                               "an error or a value of another store at each vertex");
        }
        keep_on_border(store.layout().lattice());
        if (!header_.curved) {
            require_float32_places(store, asked.steps, asked.origin,
                                   asked.product == Product::graph);
        }
        if (asked.traversal.attributes.value && !asked.traversal.attributes.wide_value) {
            require_float32_values(asked.values_in(store));
        }
        return finish();
    }
    /// Sets how vertices are rounded and separated.
    ExtractQuery finish() {
        asked.coordinate_rounding =
            coordinate_rounding(asked.around.value_or(header_.nodes), asked.steps, asked.origin);
        if (const Directions rotation = header_.rotation(); rotation != kAlongWorld) {
            asked.rotation = Rotation{header_.origin, rotation};
            asked.min_apart =
                std::max(kMinApart, asked.rotation->min_step(header_.nodes, header_.steps()));
        }
        asked.moves_apart = is_short_step(step_apart(asked.coordinate_rounding, asked.min_apart));
        return std::move(asked);
    }

  private:
    /// The lattice that contains all positions. Its cells are cubes as long as the shortest mean
    /// distance between neighbouring nodes, unless there would be too many.
    void place_around(const CurvedNodes& nodes) {
        const double step = *std::min_element(nodes.step.begin(), nodes.step.end());
        asked.origin = nodes.low;
        Int3& count = asked.around.emplace();
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double extent = nodes.high[a] - nodes.low[a];
            constexpr auto kMaxCells = static_cast<double>(kMaxNodesPerAxis - 1);
            asked.steps.along[a] = std::max(step, extent / kMaxCells);
            count[axis] = std::min<std::int64_t>(
                              static_cast<std::int64_t>(std::ceil(extent / asked.steps.along[a])),
                              kMaxNodesPerAxis - 2) +
                          2;
        }
    }
    [[nodiscard]] Double3 own_place(const Double3& p) const {
        return unrotated_about(header_.origin, header_.rotation(), p);
    }
    /// A slice across an axis within the box must not be clipped along that axis: a slice in the
    /// box's own face would be lost. Data in a plane have no extent along their flat axis.
    void keep_on_border(const Lattice& lattice) {
        TraversalQuery& query = asked.traversal;
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

    const StoreHeader& header_;
    const std::optional<WorldBox>& box_;
    bool is_along_world_;
};

}  // namespace

double MeshPlace::max_moved() const {
    const LatticeSteps& steps = lattice.steps;
    return steps.is_sheared() ? rounding * steps.diagonal()
                              : std::sqrt(3.0) * rounding * steps.longest();
}

PatchBox MeshPlace::faces_of(const ClipBox& of) const {
    if (!has_faces) {
        return {};
    }
    constexpr double kMore = 4;
    return box_faces(of.lo, of.hi, lattice.steps, lattice.origin, kMore * max_moved());
}

void ExtractQuery::watch(PartStore& parts) const {
    if (keeps_apart()) {
        parts.watch({sight_apart(coordinate_rounding, min_apart), traversal.box});
    }
    if (traversal.attributes.normal) {
        parts.count_normals();
    }
}

CurvedPlacing ExtractQuery::placing() const {
    CurvedPlacing placing;
    placing.is_of_tetrahedra = traversal.cells == Cells::tetrahedra;
    placing.has_normals = traversal.attributes.normal;
    placing.box = traversal.box;
    if (keeps_apart()) {
        placing.sight =
            std::sqrt(3.0) * sight_apart(coordinate_rounding, min_apart) * steps.longest();
    }
    return placing;
}

ApartRange ExtractQuery::apart_range() const {
    ApartRange range;
    range.moves = moves_apart;
    range.rotation = rotation;
    const Double3 least = steps.min_along();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        range.min_step[axis] = std::fabs(least[axis]) * min_apart;
    }
    return range;
}

MemoryShare memory_of(const ExtractOptions& options, const std::string& name) {
    return {name, options.memory, Workers::count_of(options.threads)};
}

double world_distance(const StoreHeader& header, const DistanceBound& asked) {
    const Double3 spacing = header.curved   ? header.curved->step
                            : header.uneven ? header.steps().min_along()
                                            : header.spacing;
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
    Asking asking(store, query.box);
    ExtractQuery& asked = asking.asked;
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
    const Stop stop =
        stop_for(store, query.stop, cells,
                 effort == Effort::none ? CellField::needed_by_errors : CellField::not_needed);
    asking.begin(store, flat ? Product::isolines : Product::surface, stop, cells);
    asking.stop_below(stop.threshold, query.focus, query.camera);
    asked.traversal.iso = query.iso;
    asked.traversal.vertices = grid.vertices;
    if (cells == Cells::tetrahedra) {
        asked.traversal.bound = bound_of(store, grid.bound);
    }
    if (grid.culling) {
        asking.cull(store, *grid.culling);
    }
    asking.choose_distance(query.stop, effort);
    if (std::holds_alternative<ErrorBound>(query.stop) && effort != Effort::none) {
        if (stop.threshold > 0) {
            asked.stages.error = stop.threshold;
            asked.stages.error_effort = effort;
        }
        // Hexahedra are simplified from full resolution, and so are volumes with uneven axes.
        const double share = cells == Cells::hexahedra || asked.steps.uneven != nullptr
                                 ? 0
                                 : nested_share(grid.vertices);
        asking.stop_below(share * stop.threshold);
    }
    if (query.analysis) {
        asked.analysis_folder =
            query.analysis->folder.empty() ? analysis_folder_of(store) : query.analysis->folder;
    }
    asking.choose_stages(query.stages);
    asking.choose_attributes(store, query.attributes, false, float64);
    return asking.finish(store);
}

ExtractQuery extract_query(const VolumeDescription& volume, const SurfaceQuery& query) {
    const StoreHeader header = header_of(volume);
    Asking asking(header, volume.name, query.box);
    const Features features =
        features_of(query, {Lattice(volume.nodes).dimension(), is_uneven(volume)});
    require_combination(features, volume.name);
    if (volume.curved) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    "the surface of a curvilinear grid needs a store", {{RemedyKind::make_store}});
    }
    if (needs_store(volume, features, query.grid.bound.has_value())) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    "errors, fields, several resolutions and vertex values need a store; directly "
                    "from a volume, a surface can be extracted at full resolution, or simplified "
                    "within a distance or to a number of triangles",
                    {{RemedyKind::make_store}});
    }
    require_marchable(volume, query.iso);
    require_distance(query.stop);
    require_simplifiable(query.effort, !is_full_resolution(query.stop));
    const Cells cells = cells_of(features);
    asking.begin(Product::surface,
                 {cells == Cells::hexahedra ? Field::hex_deviation : Field::deviation_bar, 0, 0},
                 cells);
    asking.asked.traversal.iso = query.iso;
    asking.asked.traversal.attributes.normal = query.attributes.normals;
    asking.choose_distance(query.stop, effort_of(features));
    asking.choose_stages(query.stages);
    return asking.finish();
}

ExtractQuery extract_query(const StoreReader& store, const LabelQuery& query, bool float64) {
    Asking asking(store, query.box);
    const Features features = features_of(store, query);
    require_combination(features, store.path().string());
    require_simplifiable(query.effort, query.stop.has_value());
    const SurfaceStop stop =
        query.stop ? std::visit([](const auto& s) { return SurfaceStop(s); }, *query.stop)
                   : SurfaceStop();
    const Cells cells = cells_of(features);
    asking.begin(store, Product::surface, stop_for(store, stop, cells, CellField::not_needed),
                 cells);
    if (cells == Cells::tetrahedra) {
        asking.asked.traversal.bound = bound_of(store, {});
    }
    asking.choose_distance(stop, effort_of(features));
    require_label(store, query.label.id);
    asking.choose_label(query.label);
    asking.choose_stages(query.stages);
    asking.choose_attributes(store, query.attributes, false, float64);
    return asking.finish(store);
}

ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64) {
    Asking asking(store, query.box);
    ExtractQuery& asked = asking.asked;
    require_numbers(store, "a slice");
    require_not_curved(store.layout().header(), store.path().string(), "a slice");
    require_volume(store);
    require_combination(plane_features(query.focus || query.camera, query.cells),
                        store.path().string());
    const Stop stop = stop_for(store, query.stop, query.cells, CellField::needed);
    asking.begin(store, Product::slice, stop, query.cells);
    asking.stop_below(stop.threshold, query.focus, query.camera);
    asking.cut(query.plane);
    asking.choose_attributes(store, query.attributes, true, float64);
    // The orientation of triangles: towards the smaller distance from the plane.
    Double3& facing = asked.traversal.attributes.plane_normal.emplace();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        facing[axis] = 0 - asked.traversal.plane->normal[axis] / asked.steps.along[axis];
    }
    facing = asked.steps.gradient(facing);
    return asking.finish(store);
}

ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool /*float64*/) {
    Asking asking(store, query.box);
    require_numbers(store, "contour lines");
    require_not_curved(store.layout().header(), store.path().string(), "a slice");
    require_volume(store);
    require_contours(query.values);
    const Stop stop = stop_of(store, query.stop);
    asking.begin(store, Product::contours, stop, Cells::tetrahedra);
    asking.stop_below(stop.threshold, query.focus, query.camera);
    asking.cut(query.plane);
    asking.asked.contours = query.values;
    // Contours are found among the exact values, independent of the precision of the lines' sink.
    asking.asked.traversal.attributes.value = true;
    asking.asked.traversal.attributes.wide_value = !held_by_float32(store);
    return asking.finish(store);
}

ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64) {
    if (store.layout().header().direction != kAlongWorld) {
        throw Error(ErrorKind::unsupported, {store.path().string()},
                    "a graph needs axes along the world's; preprocess the data without directions",
                    {{RemedyKind::place_in_world, "spacing"}});
    }
    Asking asking(store, query.box);
    ExtractQuery& asked = asking.asked;
    require_numbers(store, "a graph");
    require_plane(store);
    require_combination(plane_features(query.focus || query.camera, query.cells),
                        store.path().string());
    require_even_axes(store.layout().header(), store.path().string(), "a graph");
    if (!std::isfinite(query.scale)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("scale {}: must be a finite number", query.scale));
    }
    const Stop stop = stop_for(store, query.stop, query.cells, CellField::needed_by_errors);
    asking.begin(store, Product::graph, stop, query.cells);
    asking.stop_below(stop.threshold, query.focus, query.camera);
    asked.steps.along[2] = query.scale;
    asked.origin[2] = 0;
    asked.graph_scale = query.scale;
    asked.traversal.attributes.graph_scale = query.scale;
    asking.choose_attributes(store, query.attributes, false, float64);
    return asking.finish(store);
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
