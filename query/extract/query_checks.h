// Validation of queries, and conversion of their options to numbers.
#pragma once

#include <optional>
#include <span>
#include <string>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "store/container/reader.h"

namespace isonest::detail {

// The interval of the volume of the solid at full resolution.

/// For the solid that `query` closes. `tolerance`: the error of its stop, in units of the data.
/// Nothing if the surface cannot be closed because of missing values. Throws as extract().
/// REQUIRES: the features of the query can be combined with an interval of the volume, which the
/// query itself does not request.
std::optional<VolumeInterval> volume_interval(const Store& store, const SurfaceQuery& query,
                                              double tolerance, const ExtractOptions& options,
                                              Progress& progress);

/// Throws Error{not_found} if the store lacks the field that `what` needs.
void require_stored(const StoreReader& store, Field field, const std::string& what);
/// The same for a field of nodes; throws Error{invalid_argument} for a field of cells.
void require_field(const StoreReader& store, Field field, const std::string& what);

/// Throws Error{invalid_argument} for data in a plane, which have no slices.
void require_volume(const StoreReader& store);
/// Throws Error{invalid_argument} unless the data are in a plane, with one node along z, as needed
/// for a graph.
void require_plane(const StoreReader& store);

/// Throws Error{invalid_argument, limit}.
void require_contours(std::span<const double> values);

/// The field of the stop test, and its threshold in the field's own units: nodes below it stop.
/// `asked`: the requested error or threshold. An error is one of the volume's values, so the
/// threshold is smaller by the tolerance to which the store's values were rounded.
/// Throws Error{invalid_argument, not_found}.
struct Stop {
    Field field;
    double threshold;
    double asked;
};
Stop stop_of(const StoreReader& store, const isonest::StopTest& test);
Stop stop_of(const StoreReader& store, const SurfaceStop& test);
/// When the stop field of hexahedral cells must be in the store.
enum class CellField : std::uint8_t { needed, needed_by_errors, not_needed };
/// The same for hexahedral cells.
Stop stop_of_cells(const StoreReader& store, const isonest::StopTest& test, CellField cell_field);
Stop stop_of_cells(const StoreReader& store, const SurfaceStop& test, CellField cell_field);

/// The error in the data's units. Throws Error{invalid_argument}.
double error_of(const StoreReader& store, const ErrorBound& asked);
/// What is left of an error for the difference from the store's rounded values. Throws
/// Error{invalid_argument} if it is above 0 but less than their tolerance.
double error_left(const StoreReader& store, double error);
/// The tolerance to which the store's values were rounded; 0: they were not.
double tolerance_of(const StoreReader& store);

/// Throws Error{invalid_argument} if this label cannot be a value of the store.
void require_label(const StoreReader& store, std::int64_t label);

/// Throws Error{invalid_argument} for an invalid distance or triangle budget.
void require_distance(const SurfaceStop& stop);

/// Whether the stop test requests an error of 0.
bool is_full_resolution(const SurfaceStop& stop);

/// Throws Error{invalid_argument} for an effort of simplification if the mesh may not be changed.
void require_simplifiable(const std::optional<Effort>& effort, bool may_change);

/// Throws Error{invalid_argument} for an invalid minimum volume.
void require_components(const ComponentChoice& choice);

/// Throws Error{limit} if the mesh would need coordinates beyond float32. `has_heights`: those
/// along z are values.
void require_float32_places(const StoreReader& store, const LatticeSteps& steps,
                            const Double3& origin, bool has_heights);
/// The same for values that the mesh stores as float32.
void require_float32_values(const StoreReader& store);

}  // namespace isonest::detail
