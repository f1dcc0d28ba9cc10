#include "query/extract/combinations.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <initializer_list>

#include "query/extract/query_checks.h"
#include "query/extract/stages/simplify_stages.h"

namespace isonest::detail {
namespace {

constexpr Features of(std::initializer_list<Feature> features) {
    unsigned long long bits = 0;
    for (const Feature feature : features) {
        bits |= 1ULL << static_cast<unsigned>(feature);
    }
    return {bits};
}

constexpr std::array kRefused{
    Combination{Feature::uneven_axes,
                of({Feature::culling, Feature::smooth_label, Feature::nested_distance,
                    Feature::volume_interval}),
                "these need nodes at even distances; within a distance the effort fast or best "
                "gives the mesh"},
    Combination{Feature::isolines,
                of({Feature::culling, Feature::closing, Feature::label, Feature::hexahedra,
                    Feature::triangles, Feature::fast, Feature::simplified_error,
                    Feature::nested_distance, Feature::min_volume}),
                "data in a plane have lines instead of a surface; lines can only be simplified "
                "within a distance, with the best effort"},
    Combination{
        Feature::hexahedra,
        of({Feature::culling, Feature::exact_vertices, Feature::place, Feature::nested_distance}),
        "the nested grid of hexahedral cells can only be refined by an error; use tetrahedra"},
    Combination{Feature::coarse_hexahedra, of({Feature::closing}),
                "hexahedral cells can only be closed at full resolution, simplified or not; use "
                "tetrahedra"},
    Combination{
        Feature::label,
        of({Feature::error, Feature::nested_distance, Feature::place, Feature::culling,
            Feature::exact_vertices}),
        "a store has errors of values, not of labels; use a distance or a number of triangles"},
    Combination{Feature::smooth_label,
                of({Feature::box, Feature::hexahedra, Feature::tetrahedra, Feature::normals,
                    Feature::vertex_fields, Feature::closing_above}),
                "smooth labels are closed surface nets with one vertex per cell, and neighbours "
                "share their surfaces"},
    Combination{Feature::stepped_label, of({Feature::interfaces, Feature::details}),
                "labels that are not smooth share no triangles; use smooth labels (0 passes keep "
                "the faces of the voxels)"},
    Combination{Feature::components,
                of({Feature::simplified_label, Feature::interfaces, Feature::details,
                    Feature::nested_distance}),
                "components are chosen in the full surface of one label or isovalue, before it is "
                "simplified"},
    Combination{Feature::closing,
                of({Feature::culling, Feature::exact_vertices, Feature::nested_distance}),
                "caps need the whole solid, with linearly interpolated vertices; at full "
                "resolution, these are exact anyway"},
    Combination{Feature::place,
                of({Feature::distance, Feature::nested_distance, Feature::simplified_error}),
                "a distance, and the error of a simplified mesh, are the same everywhere; for a "
                "focus or camera, use an error with the effort none"},
    Combination{Feature::simplified_error, of({Feature::threshold, Feature::estimate}),
                "simplification needs a proven bound on the values; use the effort none"},
    Combination{Feature::exact_vertices, of({Feature::distance}),
                "within a distance, vertices come from the surface at full resolution, where they "
                "are exact"},
    Combination{Feature::nested_distance, of({Feature::triangles, Feature::culling}),
                "with the effort none, the nested grid of the whole surface is refined to the "
                "distance; for a number of triangles, use simplification, or the smallest error"},
    Combination{Feature::analysis,
                of({Feature::isolines, Feature::no_distance, Feature::fast, Feature::culling,
                    Feature::label}),
                "an analysis keeps meshes of a whole isosurface within several distances, "
                "simplified with the best effort"},
    Combination{Feature::volume_interval,
                of({Feature::isolines, Feature::open, Feature::components, Feature::place,
                    Feature::label, Feature::threshold, Feature::estimate, Feature::nested_distance,
                    Feature::hexahedra, Feature::distance}),
                "the interval needs a whole closed solid, and one proven error of the values on "
                "tetrahedra; within a distance, the full volume itself is reported"},
};

void set(Features& features, Feature feature, bool is_requested = true) {
    if (is_requested) {
        features.set(static_cast<std::size_t>(feature));
    }
}

bool has(const Features& features, Feature feature) {
    return features[static_cast<std::size_t>(feature)];
}

/// Whether no requested feature excludes `feature`.
bool goes_with(const Features& features, Feature feature) {
    return std::none_of(kRefused.begin(), kRefused.end(), [&](const Combination& row) {
        return row.feature == feature ? (row.with & features).any()
                                      : has(features, row.feature) && has(row.with, feature);
    });
}

/// Sets the features of the stop test. Without an effort: the one that suits the other features
/// best.
struct StopFeatures {
    Features& features;
    std::optional<Effort> effort;

    void operator()(const ErrorBound& stop) const {
        set(features, Feature::error, stop.value != 0);
        set(features, Feature::estimate, stop.indicator == ErrorIndicator::estimate);
        choose_effort(stop.value != 0);
    }
    void operator()(const FieldThreshold& /*stop*/) const {
        set(features, Feature::error);
        set(features, Feature::threshold);
        choose_effort(effort.has_value());
    }
    void operator()(const TriangleBudgetByError& stop) const {
        set(features, Feature::error);
        set(features, Feature::estimate, stop.indicator == ErrorIndicator::estimate);
        choose_effort(true);
    }
    void operator()(const DistanceBound& /*stop*/) const { choose_distance(); }
    void operator()(const TriangleBudgetByDistance& /*stop*/) const {
        set(features, Feature::triangles);
        choose_distance();
    }

  private:
    void choose_effort(bool has_error) const {
        const bool is_simplified =
            effort ? *effort != Effort::none : goes_with(features, Feature::simplified_error);
        set(features, Feature::simplified_error, has_error && is_simplified);
        set(features, Feature::fast, has_error && effort == Effort::fast);
    }
    void choose_distance() const {
        set(features, effort == Effort::none ? Feature::nested_distance : Feature::distance);
        set(features, Feature::fast, effort == Effort::fast);
    }
};

Features stage_features(const SurfaceStages& stages) {
    Features features;
    set(features, Feature::closing, stages.close.has_value());
    set(features, Feature::closing_above, stages.close == Outside::above);
    set(features, Feature::components, stages.components.has_value());
    set(features, Feature::min_volume, stages.components && stages.components->min_volume > 0);
    return features;
}

/// `given`: nothing if the cells are to be chosen by all of the other features. `is_cheaper`: as
/// for features_of().
void set_cells(Features& features, const std::optional<Cells>& given,
               const std::function<bool()>& is_cheaper) {
    const auto is_chosen = [&] {
        const bool is_within_error = has(features, Feature::simplified_error);
        return (is_within_error || !has(features, Feature::error)) &&
               goes_with(features, Feature::hexahedra) &&
               (!is_within_error || (is_cheaper && is_cheaper()));
    };
    set(features, Feature::hexahedra, given ? *given == Cells::hexahedra : is_chosen());
    set(features, Feature::coarse_hexahedra,
        has(features, Feature::hexahedra) && has(features, Feature::error) &&
            !has(features, Feature::simplified_error));
}

}  // namespace

Features features_of(const SurfaceQuery& query, const VolumeShape& shape,
                     const std::function<bool()>& is_cheaper) {
    Features features = stage_features(query.stages);
    set(features, Feature::place, query.focus || query.camera);
    set(features, Feature::exact_vertices, query.grid.vertices == VertexPlace::exact);
    set(features, Feature::culling, query.grid.culling.has_value());
    set(features, Feature::tetrahedra, query.grid.cells == Cells::tetrahedra);
    set(features, Feature::box, query.box.has_value());
    set(features, Feature::vertex_fields,
        query.attributes.error || query.attributes.values != nullptr);
    set(features, Feature::analysis, query.analysis.has_value());
    set(features, Feature::open, !query.stages.close);
    set(features, Feature::volume_interval, query.volume_interval);
    set(features, Feature::isolines, shape.dimension == 2);
    set(features, Feature::uneven_axes, shape.is_uneven);
    std::visit(StopFeatures{features, query.effort}, query.stop);
    set(features, Feature::no_distance, !has(features, Feature::distance));
    // A field by which elements are skipped is one of tetrahedra.
    set_cells(features,
              query.grid.bound ? query.grid.cells.value_or(Cells::tetrahedra) : query.grid.cells,
              is_cheaper);
    return features;
}

const char* name_of(Feature feature) {
    switch (feature) {
        case Feature::uneven_axes:
            return "uneven axes or a curvilinear grid";
        case Feature::isolines:
            return "isolines";
        case Feature::label:
            return "the surface of a label";
        case Feature::smooth_label:
            return "smooth labels";
        case Feature::simplified_label:
            return "smooth labels within a distance or of a number of triangles";
        case Feature::stepped_label:
            return "labels that are not smooth";
        case Feature::interfaces:
            return "interfaces of labels";
        case Feature::details:
            return "levels of detail";
        case Feature::hexahedra:
            return "hexahedral cells";
        case Feature::coarse_hexahedra:
            return "the nested grid of hexahedral cells";
        case Feature::tetrahedra:
            return "tetrahedral cells";
        case Feature::exact_vertices:
            return "exact vertices";
        case Feature::place:
            return "a focus or camera";
        case Feature::culling:
            return "backface culling";
        case Feature::box:
            return "a box";
        case Feature::normals:
            return "normals";
        case Feature::vertex_fields:
            return "errors or other values at the vertices";
        case Feature::error:
            return "an error above 0 or a field's threshold";
        case Feature::threshold:
            return "a field's threshold";
        case Feature::estimate:
            return "the indicator estimate";
        case Feature::distance:
            return "a distance or a number of triangles";
        case Feature::no_distance:
            return "an error or full resolution";
        case Feature::triangles:
            return "a number of triangles";
        case Feature::fast:
            return "the effort fast";
        case Feature::nested_distance:
            return "a distance with the effort none";
        case Feature::simplified_error:
            return "simplification within an error";
        case Feature::closing:
            return "closing";
        case Feature::closing_above:
            return "closing with the outside above";
        case Feature::open:
            return "an open surface";
        case Feature::components:
            return "a choice of components";
        case Feature::min_volume:
            return "a minimum volume of components";
        case Feature::analysis:
            return "a kept analysis";
        case Feature::volume_interval:
            return "an interval of the volume";
    }
    return "";
}

std::span<const Combination> refused_combinations() {
    return kRefused;
}

Features features_of(const StoreReader& store, const SurfaceQuery& query) {
    const StoreLayout& layout = store.layout();
    return features_of(query, {layout.lattice().dimension(), is_uneven(layout.header())}, [&] {
        const auto* const stop = std::get_if<ErrorBound>(&query.stop);
        // An indicator other than the default is one of tetrahedra.
        return stop != nullptr && stop->indicator == ErrorIndicator::deviation && stop->value > 0 &&
               hexahedra_are_cheaper(store, query.iso, error_left(store, error_of(store, *stop)));
    });
}

Features features_of(const StoreReader& store, const LabelQuery& query) {
    Features features = stage_features(query.stages);
    set(features, Feature::label);
    set(features, Feature::uneven_axes, is_uneven(store.layout().header()));
    set(features, Feature::smooth_label, query.smooth.has_value());
    set(features, Feature::stepped_label, !query.smooth);
    set(features, Feature::isolines, store.layout().lattice().dimension() == 2);
    set(features, Feature::box, query.box.has_value());
    set(features, Feature::tetrahedra, query.cells == Cells::tetrahedra);
    set(features, Feature::normals, query.attributes.normals);
    set(features, Feature::vertex_fields,
        query.attributes.error || query.attributes.values != nullptr);
    if (query.stop) {
        std::visit(StopFeatures{features, query.effort}, *query.stop);
    }
    if (query.smooth) {
        set(features, Feature::simplified_label, has(features, Feature::distance));
        set(features, Feature::hexahedra, query.cells == Cells::hexahedra);
    } else {
        set_cells(features, query.cells, {});
    }
    return features;
}

Features plane_features(bool has_place, Cells cells) {
    Features features;
    set(features, Feature::place, has_place);
    set(features, Feature::hexahedra, cells == Cells::hexahedra);
    return features;
}

Cells cells_of(const Features& features) {
    return has(features, Feature::hexahedra) ? Cells::hexahedra : Cells::tetrahedra;
}

Effort effort_of(const Features& features) {
    if (!has(features, Feature::distance) && !has(features, Feature::simplified_error)) {
        return Effort::none;
    }
    return has(features, Feature::fast) ? Effort::fast : Effort::best;
}

bool needs_store(const VolumeDescription& volume, const Features& features, bool has_bound) {
    constexpr std::array kOfStores{
        Feature::error,   Feature::simplified_error, Feature::nested_distance,
        Feature::place,   Feature::volume_interval,  Feature::exact_vertices,
        Feature::culling, Feature::vertex_fields,    Feature::analysis};
    const Int3& n = volume.nodes;
    return volume.labels || std::min({n.x, n.y, n.z}) == 1 || has_bound ||
           std::any_of(kOfStores.begin(), kOfStores.end(),
                       [&](Feature feature) { return has(features, feature); });
}

bool is_plain_surface(const SurfaceQuery& query) {
    const auto* const distance = std::get_if<DistanceBound>(&query.stop);
    return query.grid.cells != Cells::tetrahedra && !query.stages.close && !query.box &&
           !query.stages.components &&
           (std::holds_alternative<ErrorBound>(query.stop) ||
            (distance != nullptr && distance->value == 0));
}

void require_combination(const Features& features, const std::string& name) {
    for (const Combination& row : kRefused) {
        if (!has(features, row.feature)) {
            continue;
        }
        for (std::size_t i = 0; i < features.size(); ++i) {
            if (features[i] && row.with[i]) {
                throw Error(ErrorKind::invalid_argument, ErrorPlace{name},
                            fmt::format("{} cannot be combined with {}: {}", name_of(row.feature),
                                        name_of(static_cast<Feature>(i)), row.reason));
            }
        }
    }
}

}  // namespace isonest::detail
