#include "query/extract/extract_query.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "query/extract/analysis/kept_analysis.h"
#include "query/extract/combinations.h"
#include "query/extract/query_checks.h"
#include "query/extract/stages/error_stage.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/slabs/slab_plan.h"
#include "query/view/label_view.h"
#include "store/base/hypot3.h"
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
    if (!(hypot3(v[0], v[1], v[2]) > 0) || !std::isfinite(v[0] + v[1] + v[2])) {
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

/// What all queries have.
ExtractQuery begun(const StoreReader& store, Product product, const Stop& stop, Cells cells,
                   const std::optional<WorldBox>& box) {
    const StoreHeader& header = store.layout().header();
    ExtractQuery asked;
    asked.product = product;
    asked.spacing = header.spacing;
    asked.origin = header.origin;
    asked.threshold = stop.threshold;
    asked.traversal.cells = cells;
    asked.traversal.stop = stop.field;
    // Where nothing is searched the bound is not used.
    asked.traversal.bound = store.layout().tightest_bound().value_or(stop.field);
    asked.traversal.tolerance = Tolerance(stop.threshold, {}, {}, header.spacing, header.origin);
    asked.traversal.box = clip_box(store, box);
    return asked;
}

/// The same of those whose tolerance varies. `finest_needs_none`: an error of 0 needs no field of
/// cells.
template <class Query>
ExtractQuery begun(const StoreReader& store, Product product, const Query& query, Cells cells,
                   bool finest_needs_none) {
    const Stop stop = cells == Cells::hexahedra
                          ? stop_of_cells(store, query.stop, finest_needs_none)
                          : stop_of(store, query.stop);
    ExtractQuery asked = begun(store, product, stop, cells, query.box);
    asked.traversal.tolerance =
        Tolerance(stop.threshold, query.focus, query.camera, asked.spacing, asked.origin);
    return asked;
}

/// What the vertices carry. `needs_value`: also if no other store gives values.
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

/// The distances of a surface's stop: of its simplification and of the traversal.
struct DistanceOfStop {
    const StoreHeader& header;
    ExtractQuery& asked;

    void operator()(const DistanceBound& stop) const {
        asked.stages.distance = {world_distance(header, stop), std::nullopt, stop.effort};
    }
    void operator()(const TriangleBudget& stop) const {
        asked.stages.distance = {
            stop.within ? world_distance(header, *stop.within) : diagonal_of(header), stop.most,
            stop.effort};
    }
    void operator()(const NestedDistanceBound& stop) const {
        if (const double distance = world_distance(header, stop.bound); distance > 0) {
            asked.nested_distance = distance;
            asked.traversal.vertices = VertexPlace::exact;
        }
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

/// Sets the isovalue between the label and the others, and the part of the volume where it is.
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

/// How vertices are rounded and kept apart.
void choose_apart(const StoreHeader& header, ExtractQuery& asked) {
    asked.coordinate_rounding = coordinate_rounding(header.nodes, asked.spacing, asked.origin);
    if (header.direction != kAlongWorld) {
        asked.turn = Turn{header.origin, header.direction};
        asked.least_apart =
            std::max(kLeastApart, asked.turn->least_step(header.nodes, header.spacing));
    }
    asked.moves_apart = is_short_step(step_apart(asked.coordinate_rounding, asked.least_apart));
}

ExtractQuery finished(const StoreReader& store, ExtractQuery asked) {
    keep_on_border(store, asked.traversal);
    require_float32(store, asked);
    choose_apart(store.layout().header(), asked);
    return asked;
}

}  // namespace

double world_distance(const StoreHeader& header, const DistanceBound& asked) {
    double voxel = kInfinity;
    for (int axis = 0; axis < 3; ++axis) {
        if (header.nodes[axis] > 1) {
            voxel = std::min(voxel, header.spacing[static_cast<std::size_t>(axis)]);
        }
    }
    return asked.voxels && std::isfinite(voxel) ? asked.value * voxel : asked.value;
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
    const Wishes wishes = wishes_of(store, query);
    require_combination(wishes, store.path().string());
    const Cells cells = cells_of(wishes);
    const bool flat = store.layout().lattice().dimension() == 2;
    if (!std::isfinite(query.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", query.iso));
    }
    if (store.layout().header().labels) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    "its values are labels of 64 bits: a surface is that of a label");
    }
    const NestedGrid& grid = query.grid;
    ExtractQuery asked =
        begun(store, flat ? Product::isolines : Product::surface, query, cells, true);
    asked.traversal.iso = query.iso;
    asked.traversal.vertices = grid.vertices;
    if (cells == Cells::tetrahedra) {
        asked.traversal.bound = bound_of(store, grid.bound);
    }
    if (grid.culling) {
        asked.traversal.culling = culling_of(store, *grid.culling);
    }
    std::visit(DistanceOfStop{store.layout().header(), asked}, query.stop);
    if (std::holds_alternative<SimplifiedErrorBound>(query.stop)) {
        if (asked.threshold > 0) {
            asked.stages.error = asked.threshold;
        }
        asked.traversal.tolerance = Tolerance(nested_share(grid.vertices) * asked.threshold, {}, {},
                                              asked.spacing, asked.origin);
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
    require_combination(wishes_of(volume, query), volume.name);
    require_marchable(volume, query.iso);
    require_distance(query.stop);
    ExtractQuery asked;
    asked.spacing = volume.spacing;
    asked.origin = volume.origin;
    asked.traversal.iso = query.iso;
    asked.traversal.cells = Cells::hexahedra;
    asked.traversal.attributes.normal = query.attributes.normals;
    for (int axis = 0; axis < 3; ++axis) {
        asked.traversal.box.hi[static_cast<std::size_t>(axis)] =
            static_cast<double>(volume.nodes[axis] - 1);
    }
    std::visit(DistanceOfStop{header_of(volume), asked}, query.stop);
    choose_stages(query.stages, asked);
    choose_apart(header_of(volume), asked);
    return asked;
}

ExtractQuery extract_query(const StoreReader& store, const LabelQuery& query, bool float64) {
    const Wishes wishes = wishes_of(store, query);
    require_combination(wishes, store.path().string());
    const SurfaceStop stop =
        query.stop ? std::visit([](const auto& s) { return SurfaceStop(s); }, *query.stop)
                   : SurfaceStop();
    const Cells cells = cells_of(wishes);
    const bool has_cells = cells == Cells::hexahedra;
    ExtractQuery asked = begun(store, Product::surface,
                               has_cells ? stop_of_cells(store, stop, true) : stop_of(store, stop),
                               cells, query.box);
    if (!has_cells) {
        asked.traversal.bound = bound_of(store, {});
    }
    std::visit(DistanceOfStop{store.layout().header(), asked}, stop);
    choose_label(store, query.label, asked);
    choose_stages(query.stages, asked);
    choose_attributes(store, query.attributes, false, float64, asked);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64) {
    require_numbers(store, "a slice");
    require_combination(wishes_of(store, query), store.path().string());
    ExtractQuery asked = begun(store, Product::slice, query, query.cells, false);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    choose_attributes(store, query.attributes, true, float64, asked);
    // The way in which triangles face: to where the distance from the plane is less.
    Double3& facing = asked.traversal.attributes.plane_normal.emplace();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        facing[axis] = 0 - asked.traversal.plane->normal[axis] / asked.spacing[axis];
    }
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool /*float64*/) {
    require_numbers(store, "contour lines");
    require_combination(wishes_of(store, query), store.path().string());
    require_contours(query.values);
    ExtractQuery asked = begun(store, Product::contours, query, Cells::tetrahedra, false);
    asked.traversal.plane = lattice_plane(store.layout().header(), query.plane);
    asked.contours = query.values;
    // Contours are found among the values, whatever the lines' sink holds.
    asked.traversal.attributes.value = true;
    asked.traversal.attributes.wide_value = !held_by_float32(store);
    return finished(store, std::move(asked));
}

ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64) {
    require_numbers(store, "a graph");
    require_combination(wishes_of(store, query), store.path().string());
    if (!std::isfinite(query.scale)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("scale {}: must be a finite number", query.scale));
    }
    ExtractQuery asked = begun(store, Product::graph, query, query.cells, true);
    asked.spacing[2] = query.scale;
    asked.origin[2] = 0;
    asked.graph_scale = query.scale;
    asked.traversal.attributes.graph_scale = query.scale;
    choose_attributes(store, query.attributes, false, float64, asked);
    return finished(store, std::move(asked));
}

}  // namespace isonest::detail
