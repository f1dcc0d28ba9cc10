// What a query may ask for that does not go with everything: one table.
#pragma once

#include <bitset>
#include <optional>
#include <span>
#include <string>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/volume_source.h>

#include "store/container/reader.h"

namespace isonest::detail {

enum class Wish : std::uint8_t {
    // Of what data.
    plane_data,
    volume_data,
    no_store,
    // What is extracted.
    isolines,
    label,
    smooth_label,
    simplified_label,
    stepped_label,
    interfaces,
    details,
    slice,
    graph,
    // Its cells and vertices, and which elements are visited.
    hexahedra,
    coarse_hexahedra,
    tetrahedra,
    exact_vertices,
    place,
    culling,
    box,
    normals,
    vertex_fields,
    // When it stops.
    error,
    threshold,
    estimate,
    distance,
    no_distance,
    triangles,
    fast,
    nested_distance,
    simplified_error,
    // Stages, and what is kept.
    closing,
    closing_above,
    open,
    components,
    least_volume,
    analysis,
    volume_interval
};

/// How the table calls it.
const char* name_of(Wish wish);

using Wishes = std::bitset<static_cast<std::size_t>(Wish::volume_interval) + 1>;

/// A row: what does not go with what, and why, with what to do about it.
struct Combination {
    Wish wish;
    Wish with;
    const char* reason;
    std::optional<RemedyKind> remedy = {};
};

/// All rows; the first that fits is the one that is told.
std::span<const Combination> refused_combinations();

Wishes wishes_of(const StoreReader& store, const SurfaceQuery& query);
Wishes wishes_of(const StoreReader& store, const LabelQuery& query);
Wishes wishes_of(const StoreReader& store, const SliceQuery& query);
Wishes wishes_of(const StoreReader& store, const ContourQuery& query);
Wishes wishes_of(const StoreReader& store, const GraphQuery& query);
/// Of a volume without a store.
Wishes wishes_of(const VolumeDescription& volume, const SurfaceQuery& query);
/// Of the query alone, whatever the store.
Wishes wishes_of(const SurfaceQuery& query);

/// Those that are asked for, or that suit the wishes best.
Cells cells_of(const Wishes& wishes);

/// Whether what is wished from a volume without a store needs one.
bool needs_store(const Wishes& wishes);

/// Throws Error{invalid_argument} with the reason of the first row that fits. `name`: of the store,
/// or empty.
void require_combination(const Wishes& wishes, const std::string& name);

}  // namespace isonest::detail
