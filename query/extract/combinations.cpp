#include "query/extract/combinations.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace isonest::detail {
namespace {

constexpr const char* kNoErrorOfLabels =
    "the errors of a store are those of values, not of labels; ask for a distance or a number of "
    "triangles within one";
constexpr const char* kOnlyDistanceOfLabels =
    "the surface of a label goes with neither focus, camera, backfaces, exact vertices nor an "
    "analysis";
constexpr const char* kSmoothWhole =
    "smooth labels share their surfaces whole: they do not go with a box";
constexpr const char* kSmoothHasNoCells =
    "smooth labels are surface nets, whose vertices lie in the cells of the lattice: they have no "
    "other cells, and carry no normals or values";
constexpr const char* kNoPlaceOfHexahedra =
    "hexahedral cells know neither focus nor camera; tetrahedra do";
constexpr const char* kNoStopOfHexahedra =
    "hexahedral cells stop by an error, or are simplified from full resolution within a distance "
    "or to a number of triangles; tetrahedra know the other stops";
constexpr const char* kVolumeOfSolid =
    "the interval is one of the volume of a whole closed solid, whose values have one error "
    "everywhere";
constexpr const char* kVolumeByError =
    "the interval is found by a proven error of tetrahedra's values";
constexpr const char* kErrorsOfStores =
    "errors are those of a store; a volume file gives the surface at full resolution, or "
    "simplified within a distance or to a number of triangles";
constexpr const char* kHexahedraOfVolumes =
    "tetrahedra, exact vertices, closing and leaving out backfaces are of a store; a volume file "
    "is marched by hexahedra";
constexpr auto kMakeStore = RemedyKind::make_store;
constexpr const char* kDistanceEverywhere =
    "a distance holds everywhere: it goes with neither focus nor camera";

constexpr std::array kRefused{
    Combination{Wish::no_store, Wish::plane_data,
                "isolines and graphs of data in a plane need a store", kMakeStore},
    Combination{Wish::no_store, Wish::error, kErrorsOfStores, kMakeStore},
    Combination{Wish::no_store, Wish::simplified_error, kErrorsOfStores, kMakeStore},
    Combination{Wish::no_store, Wish::nested_distance, kErrorsOfStores, kMakeStore},
    Combination{Wish::no_store, Wish::place, kErrorsOfStores, kMakeStore},
    Combination{Wish::no_store, Wish::volume_interval, kErrorsOfStores, kMakeStore},
    Combination{Wish::no_store, Wish::tetrahedra, kHexahedraOfVolumes, kMakeStore},
    Combination{Wish::no_store, Wish::exact_vertices, kHexahedraOfVolumes, kMakeStore},
    Combination{Wish::no_store, Wish::culling, kHexahedraOfVolumes, kMakeStore},
    Combination{Wish::no_store, Wish::closing, kHexahedraOfVolumes, kMakeStore},
    Combination{Wish::no_store, Wish::box,
                "a box cuts the surface of a store; a volume file is cropped when it is opened, "
                "by numbers of nodes",
                kMakeStore},
    Combination{Wish::no_store, Wish::vertex_fields,
                "vertices of a volume file carry normals; fields and values of stores need a store",
                kMakeStore},
    Combination{Wish::no_store, Wish::analysis, "an analysis is kept of a store", kMakeStore},
    Combination{Wish::graph, Wish::volume_data, "a graph needs data in a plane, one node along z"},
    Combination{Wish::slice, Wish::plane_data, "a slice needs a volume", RemedyKind::graph},
    Combination{Wish::culling, Wish::isolines, "leaving out backfaces needs a volume"},
    Combination{Wish::closing, Wish::isolines,
                "closing needs a volume, with more than one node along each axis"},
    Combination{Wish::label, Wish::isolines,
                "labels have surfaces in a volume, with more than one node along each axis"},
    Combination{Wish::hexahedra, Wish::isolines,
                "hexahedral cells give no isolines of data in a plane; tetrahedra do"},
    Combination{Wish::triangles, Wish::isolines, "isolines have no triangles; ask for a distance"},
    Combination{Wish::fast, Wish::isolines,
                "isolines are simplified fast in any case, with the fewest lines"},
    Combination{Wish::simplified_error, Wish::isolines,
                "isolines are not simplified within an error; ask for a distance"},
    Combination{Wish::nested_distance, Wish::isolines,
                "isolines have no nested grid within a distance; simplified, a distance goes with "
                "it"},
    Combination{Wish::analysis, Wish::isolines,
                "analyses are kept of surfaces; lines are simplified fast enough without"},
    Combination{Wish::least_volume, Wish::isolines,
                "isolines of data in a plane have no volume; give the least number of lines"},
    Combination{Wish::coarse_hexahedra, Wish::closing,
                "hexahedral cells have caps at full resolution, simplified or not; tetrahedra have "
                "them with an error as well"},
    Combination{Wish::hexahedra, Wish::culling,
                "hexahedral cells leave out no backfaces; tetrahedra do"},
    Combination{Wish::hexahedra, Wish::exact_vertices,
                "hexahedral cells have no exact vertices; tetrahedra do"},
    Combination{Wish::hexahedra, Wish::place, kNoPlaceOfHexahedra},
    Combination{Wish::hexahedra, Wish::nested_distance, kNoStopOfHexahedra},
    Combination{Wish::hexahedra, Wish::simplified_error, kNoStopOfHexahedra},
    Combination{Wish::label, Wish::error, kNoErrorOfLabels},
    Combination{Wish::label, Wish::nested_distance, kNoErrorOfLabels},
    Combination{Wish::label, Wish::place, kOnlyDistanceOfLabels},
    Combination{Wish::label, Wish::culling, kOnlyDistanceOfLabels},
    Combination{Wish::label, Wish::exact_vertices, kOnlyDistanceOfLabels},
    Combination{Wish::label, Wish::analysis, kOnlyDistanceOfLabels},
    Combination{Wish::simplified_label, Wish::components,
                "components of smooth labels are chosen label by label, and what is simplified is "
                "shared by all of them; ask for one of the two"},
    Combination{Wish::smooth_label, Wish::box, kSmoothWhole},
    Combination{Wish::smooth_label, Wish::hexahedra, kSmoothHasNoCells},
    Combination{Wish::smooth_label, Wish::tetrahedra, kSmoothHasNoCells},
    Combination{Wish::smooth_label, Wish::normals, kSmoothHasNoCells},
    Combination{Wish::smooth_label, Wish::vertex_fields, kSmoothHasNoCells},
    Combination{Wish::smooth_label, Wish::closing_above,
                "a smooth label is closed as a solid: what is outside of the volume is not of the "
                "label"},
    Combination{Wish::interfaces, Wish::components,
                "components are chosen of labels' meshes, not of interfaces, which several labels "
                "share"},
    Combination{Wish::interfaces, Wish::stepped_label,
                "interfaces are those of smooth labels, which share triangles; labels half way "
                "between nodes do not. Ask for smooth ones, with no passes if the faces of the "
                "voxels are to stay"},
    Combination{Wish::details, Wish::components,
                "components of smooth labels are chosen label by label, and coarser levels of "
                "detail are simplified for all of them together"},
    Combination{Wish::details, Wish::stepped_label,
                "levels of detail are those of smooth labels, which are simplified fast; ask for "
                "smooth ones, with no passes if the faces of the voxels are to stay"},
    Combination{Wish::closing, Wish::culling,
                "a surface is open where its backfaces are left out: it cannot be closed and "
                "culled"},
    Combination{Wish::closing, Wish::exact_vertices,
                "caps are cut out of linear functions: a closed surface has linear vertices, or, "
                "at full resolution, exact ones in any case"},
    Combination{Wish::distance, Wish::place, kDistanceEverywhere},
    Combination{Wish::distance, Wish::exact_vertices,
                "within a distance the mesh is near to the surface at full resolution in any "
                "case, whose vertices are exact"},
    Combination{Wish::nested_distance, Wish::place, kDistanceEverywhere},
    Combination{Wish::nested_distance, Wish::closing,
                "caps are cut out of linear functions, not of a nested grid within a distance; "
                "simplified, a distance goes with it"},
    Combination{Wish::nested_distance, Wish::components,
                "components are those of the full surface, which a nested grid does not know; "
                "simplified, a distance goes with it"},
    Combination{Wish::nested_distance, Wish::culling,
                "a distance is from the whole surface, not from what a viewer sees of it"},
    Combination{Wish::simplified_error, Wish::place,
                "a surface is simplified within one error everywhere: it goes with neither focus "
                "nor camera"},
    Combination{Wish::simplified_error, Wish::estimate,
                "an estimate proves nothing about the triangles of a simplified surface; the other "
                "guarantees do"},
    Combination{Wish::analysis, Wish::no_distance,
                "an analysis is kept for a distance or a number of triangles; ask for one"},
    Combination{Wish::analysis, Wish::fast,
                "an analysis keeps the meshes of the best effort, and is for meshes that are asked "
                "for again; ask for one of the two"},
    Combination{Wish::analysis, Wish::culling,
                "an analysis is kept of a whole surface, not of what a viewer sees of it"},
    Combination{Wish::volume_interval, Wish::isolines, kVolumeOfSolid},
    Combination{Wish::volume_interval, Wish::open, kVolumeOfSolid},
    Combination{Wish::volume_interval, Wish::components, kVolumeOfSolid},
    Combination{Wish::volume_interval, Wish::place, kVolumeOfSolid},
    Combination{Wish::volume_interval, Wish::label, kVolumeByError},
    Combination{Wish::volume_interval, Wish::threshold, kVolumeByError},
    Combination{Wish::volume_interval, Wish::estimate, kVolumeByError},
    Combination{Wish::volume_interval, Wish::nested_distance, kVolumeByError},
    Combination{Wish::hexahedra, Wish::volume_interval, kVolumeByError},
    Combination{Wish::volume_interval, Wish::distance,
                "within a distance the report has the volume at full resolution itself"},
};

void set(Wishes& wishes, Wish wish, bool is_wished = true) {
    if (is_wished) {
        wishes.set(static_cast<std::size_t>(wish));
    }
}

bool has(const Wishes& wishes, Wish wish) {
    return wishes[static_cast<std::size_t>(wish)];
}

bool fits(const Combination& row, const Wishes& wishes) {
    return has(wishes, row.wish) && has(wishes, row.with);
}

bool is_flat(const StoreReader& store) {
    return store.layout().lattice().dimension() == 2;
}

/// What the stop wishes.
struct StopWishes {
    Wishes& wishes;

    void operator()(const ErrorBound& stop) const {
        set(wishes, Wish::error, stop.value != 0);
        set(wishes, Wish::estimate, stop.guarantee == Guarantee::estimate);
    }
    void operator()(const FieldThreshold& /*stop*/) const {
        set(wishes, Wish::error);
        set(wishes, Wish::threshold);
    }
    void operator()(const ErrorBudget& stop) const {
        set(wishes, Wish::error);
        set(wishes, Wish::estimate, stop.guarantee == Guarantee::estimate);
    }
    void operator()(const DistanceBound& stop) const {
        set(wishes, Wish::distance);
        set(wishes, Wish::fast, stop.effort == Effort::fast);
    }
    void operator()(const TriangleBudget& stop) const {
        set(wishes, Wish::distance);
        set(wishes, Wish::triangles);
        set(wishes, Wish::fast, stop.effort == Effort::fast);
    }
    void operator()(const NestedDistanceBound& /*stop*/) const {
        set(wishes, Wish::nested_distance);
    }
    void operator()(const SimplifiedErrorBound& stop) const {
        (*this)(stop.bound);
        set(wishes, Wish::simplified_error);
    }
};

template <class Query>
Wishes place_wishes(const Query& query) {
    Wishes wishes;
    set(wishes, Wish::place, query.focus || query.camera);
    return wishes;
}

Wishes stage_wishes(const SurfaceStages& stages) {
    Wishes wishes;
    set(wishes, Wish::closing, stages.close.has_value());
    set(wishes, Wish::closing_above, stages.close == Outside::above);
    set(wishes, Wish::components, stages.components.has_value());
    set(wishes, Wish::least_volume, stages.components && stages.components->least_volume > 0);
    return wishes;
}

/// `given`: nothing if the cells are to be chosen by all of the other wishes.
void set_cells(Wishes& wishes, const std::optional<Cells>& given) {
    const auto goes_with_hexahedra = [&](const Combination& row) {
        return row.wish != Wish::hexahedra || !has(wishes, row.with);
    };
    const bool is_chosen = has(wishes, Wish::distance) &&
                           std::all_of(kRefused.begin(), kRefused.end(), goes_with_hexahedra);
    set(wishes, Wish::hexahedra, given ? *given == Cells::hexahedra : is_chosen);
    set(wishes, Wish::coarse_hexahedra, has(wishes, Wish::hexahedra) && has(wishes, Wish::error));
}

Wishes surface_wishes(const SurfaceQuery& query, bool isolines) {
    Wishes wishes = place_wishes(query) | stage_wishes(query.stages);
    std::visit(StopWishes{wishes}, query.stop);
    set(wishes, Wish::no_distance, !has(wishes, Wish::distance));
    set(wishes, Wish::exact_vertices, query.grid.vertices == VertexPlace::exact);
    set(wishes, Wish::culling, query.grid.culling.has_value());
    set(wishes, Wish::tetrahedra, query.grid.cells == Cells::tetrahedra);
    set(wishes, Wish::box, query.box.has_value());
    set(wishes, Wish::vertex_fields, query.attributes.error || query.attributes.values != nullptr);
    set(wishes, Wish::analysis, query.analysis.has_value());
    set(wishes, Wish::open, !query.stages.close);
    set(wishes, Wish::volume_interval, query.volume_interval);
    set(wishes, Wish::isolines, isolines);
    // A field by which elements are left out is one of tetrahedra.
    set_cells(wishes,
              query.grid.bound ? query.grid.cells.value_or(Cells::tetrahedra) : query.grid.cells);
    return wishes;
}

}  // namespace

const char* name_of(Wish wish) {
    switch (wish) {
        case Wish::plane_data:
            return "data in a plane";
        case Wish::volume_data:
            return "a volume";
        case Wish::no_store:
            return "a volume file, without a store";
        case Wish::isolines:
            return "isolines";
        case Wish::label:
            return "a label";
        case Wish::smooth_label:
            return "smooth labels";
        case Wish::simplified_label:
            return "smooth labels within a distance or of a number of triangles";
        case Wish::stepped_label:
            return "a label that is not smooth";
        case Wish::interfaces:
            return "interfaces";
        case Wish::details:
            return "levels of detail";
        case Wish::slice:
            return "a slice";
        case Wish::graph:
            return "a graph";
        case Wish::hexahedra:
            return "hexahedral cells";
        case Wish::coarse_hexahedra:
            return "hexahedral cells with an error above 0, or a field's threshold";
        case Wish::tetrahedra:
            return "tetrahedra by name";
        case Wish::exact_vertices:
            return "exact vertices";
        case Wish::place:
            return "focus or camera";
        case Wish::culling:
            return "leaving out backfaces";
        case Wish::box:
            return "a box";
        case Wish::normals:
            return "normals at the vertices";
        case Wish::vertex_fields:
            return "errors or other values at the vertices";
        case Wish::error:
            return "an error above 0, or a field's threshold";
        case Wish::threshold:
            return "a field's threshold";
        case Wish::estimate:
            return "an estimate";
        case Wish::distance:
            return "a distance or a number of triangles";
        case Wish::no_distance:
            return "neither a distance nor a number of triangles";
        case Wish::triangles:
            return "a number of triangles";
        case Wish::fast:
            return "the effort `fast`";
        case Wish::nested_distance:
            return "a distance without simplification";
        case Wish::simplified_error:
            return "simplification within an error";
        case Wish::closing:
            return "closing";
        case Wish::closing_above:
            return "closing with the outside above";
        case Wish::open:
            return "no closing";
        case Wish::components:
            return "a choice of components";
        case Wish::least_volume:
            return "a least volume";
        case Wish::analysis:
            return "a kept analysis";
        case Wish::volume_interval:
            return "an interval of the volume";
    }
    return "";
}

std::span<const Combination> refused_combinations() {
    return kRefused;
}

Wishes wishes_of(const SurfaceQuery& query) {
    return surface_wishes(query, false);
}

Wishes wishes_of(const StoreReader& store, const SurfaceQuery& query) {
    return surface_wishes(query, is_flat(store));
}

Wishes wishes_of(const VolumeDescription& volume, const SurfaceQuery& query) {
    Wishes wishes = surface_wishes(query, false);
    const Int3& n = volume.nodes;
    set(wishes, Wish::no_store);
    set(wishes, Wish::plane_data, std::min({n.x, n.y, n.z}) == 1);
    // A field by which elements are left out is one of tetrahedra.
    const bool by_name = query.grid.cells == Cells::tetrahedra || query.grid.bound.has_value();
    set(wishes, Wish::tetrahedra, by_name);
    wishes.set(static_cast<std::size_t>(Wish::hexahedra), !by_name);
    return wishes;
}

Wishes wishes_of(const StoreReader& store, const LabelQuery& query) {
    Wishes wishes = stage_wishes(query.stages);
    set(wishes, Wish::label);
    set(wishes, Wish::smooth_label, query.smooth.has_value());
    set(wishes, Wish::stepped_label, !query.smooth);
    set(wishes, Wish::isolines, is_flat(store));
    set(wishes, Wish::box, query.box.has_value());
    set(wishes, Wish::tetrahedra, query.cells == Cells::tetrahedra);
    set(wishes, Wish::normals, query.attributes.normals);
    set(wishes, Wish::vertex_fields, query.attributes.error || query.attributes.values != nullptr);
    if (query.stop) {
        std::visit(StopWishes{wishes}, *query.stop);
    }
    if (query.smooth) {
        set(wishes, Wish::simplified_label, has(wishes, Wish::distance));
        set(wishes, Wish::hexahedra, query.cells == Cells::hexahedra);
    } else {
        set_cells(wishes, query.cells);
    }
    return wishes;
}

Wishes wishes_of(const StoreReader& store, const SliceQuery& query) {
    Wishes wishes = place_wishes(query);
    set(wishes, Wish::slice);
    set(wishes, Wish::plane_data, is_flat(store));
    set(wishes, Wish::hexahedra, query.cells == Cells::hexahedra);
    return wishes;
}

Wishes wishes_of(const StoreReader& store, const ContourQuery& query) {
    Wishes wishes = place_wishes(query);
    set(wishes, Wish::slice);
    set(wishes, Wish::plane_data, is_flat(store));
    return wishes;
}

Wishes wishes_of(const StoreReader& store, const GraphQuery& query) {
    Wishes wishes = place_wishes(query);
    set(wishes, Wish::graph);
    set(wishes, Wish::volume_data, !is_flat(store) || store.layout().lattice().nodes().z != 1);
    set(wishes, Wish::hexahedra, query.cells == Cells::hexahedra);
    return wishes;
}

Cells cells_of(const Wishes& wishes) {
    return has(wishes, Wish::hexahedra) ? Cells::hexahedra : Cells::tetrahedra;
}

bool needs_store(const Wishes& wishes) {
    return std::any_of(kRefused.begin(), kRefused.end(), [&](const Combination& row) {
        return row.remedy == RemedyKind::make_store && fits(row, wishes);
    });
}

void require_combination(const Wishes& wishes, const std::string& name) {
    for (const Combination& row : kRefused) {
        if (fits(row, wishes)) {
            std::vector<Remedy> remedies;
            if (row.remedy) {
                remedies.push_back({*row.remedy});
            }
            throw Error(ErrorKind::invalid_argument, ErrorPlace{name}, row.reason,
                        std::move(remedies));
        }
    }
}

}  // namespace isonest::detail
