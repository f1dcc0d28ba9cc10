// What a query may not ask for, and what it asks for in numbers.
#pragma once

#include <optional>
#include <span>
#include <string>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Throws Error{not_found} if the store lacks the field that `what` needs.
void require_stored(const StoreReader& store, Field field, const std::string& what);
/// The same of a field of nodes; throws Error{invalid_argument} if it is one of cells.
void require_field(const StoreReader& store, Field field, const std::string& what);

/// Throws Error{invalid_argument, limit}.
void require_contours(std::span<const double> values);

/// The field by which nodes stop, and the number below which they do, in its own units. Throws
/// Error{invalid_argument, not_found}.
struct Stop {
    Field field;
    double threshold;
};
Stop stop_of(const StoreReader& store, const isonest::StopTest& test);
Stop stop_of(const StoreReader& store, const SurfaceStop& test);
/// The same of hexahedral cells. `finest_needs_none`: an error of 0 needs no field. REQUIRES (of a
/// surface): an error or a field's threshold.
Stop stop_of_cells(const StoreReader& store, const isonest::StopTest& test, bool finest_needs_none);
Stop stop_of_cells(const StoreReader& store, const SurfaceStop& test, bool finest_needs_none);

/// Throws Error{invalid_argument} if the store's values cannot be this label.
void require_label(const StoreReader& store, std::int64_t label);

/// Throws Error{invalid_argument} for a distance or a number of triangles that makes no sense.
void require_distance(const SurfaceStop& stop);

/// Throws Error{invalid_argument} for a least volume that makes no sense.
void require_components(const ComponentChoice& choice);

/// Throws Error{limit} where the mesh would need numbers beyond float32: coordinates, heights,
/// values that the mesh holds as float32.
void require_float32(const StoreReader& store, const ExtractQuery& query);

}  // namespace isonest::detail
