// The options of queries that cannot be combined, as one table.
#pragma once

#include <bitset>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/volume_source.h>

#include "store/container/reader.h"

namespace isonest::detail {

enum class Feature : std::uint8_t {
    // The volume.
    uneven_axes,
    // The product.
    isolines,
    label,
    smooth_label,
    simplified_label,
    stepped_label,
    interfaces,
    details,
    // Cells, vertices and visited elements.
    hexahedra,
    coarse_hexahedra,
    tetrahedra,
    exact_vertices,
    place,
    culling,
    box,
    normals,
    vertex_fields,
    // Stop tests.
    error,
    threshold,
    estimate,
    distance,
    no_distance,
    triangles,
    fast,
    nested_distance,
    simplified_error,
    // Stages, and kept data.
    closing,
    closing_above,
    open,
    components,
    min_volume,
    analysis,
    volume_interval
};

/// The feature's name in the table.
const char* name_of(Feature feature);

using Features = std::bitset<static_cast<std::size_t>(Feature::volume_interval) + 1>;

/// A row: a feature, those with which it cannot be combined, and the reason.
struct Combination {
    Feature feature;
    Features with;
    const char* reason;
};

/// All rows; the first one that applies is reported.
std::span<const Combination> refused_combinations();

/// Whether its nodes lie at uneven distances: along an axis, or anywhere.
inline bool is_uneven(const StoreHeader& header) {
    return header.uneven != nullptr || header.curved != nullptr;
}
inline bool is_uneven(const VolumeDescription& volume) {
    return volume.uneven != nullptr || volume.curved != nullptr;
}

Features features_of(const StoreReader& store, const SurfaceQuery& query);
Features features_of(const StoreReader& store, const LabelQuery& query);
/// What features depend on, of a volume without a store.
struct VolumeShape {
    int dimension = 3;
    bool is_uneven = false;  ///< see is_uneven()
};
/// Features of the query alone, or for a volume of this shape without a store. `is_cheaper`:
/// whether hexahedra cost less, if a surface is simplified within an error; empty: they do not.
/// REQUIRES for a volume (for the cells): no needs_store().
Features features_of(const SurfaceQuery& query, const VolumeShape& shape = {},
                     const std::function<bool()>& is_cheaper = {});
/// Features of a slice or a graph. `has_place`: it has a focus or a camera.
Features plane_features(bool has_place, Cells cells);

/// The requested cells, or those that suit the features best.
Cells cells_of(const Features& features);

/// Whether and how the mesh is simplified: as requested, or as suits the features best.
Effort effort_of(const Features& features);

/// Whether a query of a volume needs more than the values at full resolution. `has_bound`: it names
/// a field by which elements are skipped.
bool needs_store(const VolumeDescription& volume, const Features& features, bool has_bound);

/// Whether the query is for the whole surface of hexahedra without any processing of the mesh: for
/// a volume it is output in its own order. REQUIRES: no needs_store().
bool is_plain_surface(const SurfaceQuery& query);

/// Throws Error{invalid_argument} with the first two features that cannot be combined, and the
/// reason. `name`: of the store, or empty.
void require_combination(const Features& features, const std::string& name);

}  // namespace isonest::detail
