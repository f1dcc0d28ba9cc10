// From a store to an isosurface mesh with a guaranteed error.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/traverse/tolerance.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// What the error tolerance promises.
enum class Guarantee {
    deviation,  ///< |U - iso| <= error on the surface, by the deviation indicator: tight
    plus,       ///< the same, by eta+ of the offset indicator: looser, more triangles
    estimate    ///< eta bar of the offset indicator: usually close, no promise
};

/// A box in world units.
struct WorldBox {
    Double3 lo{};
    Double3 hi{};
};

/// The plane {normal . x = offset} in world units.
struct WorldPlane {
    Double3 normal{0, 0, 1};
    double offset = 0;
};

struct ExtractOptions {
    double iso = 0;
    /// Of a store with one flat axis: the graph z = scale U in place of isolines.
    std::optional<double> graph_scale;
    std::optional<WorldPlane> plane;  ///< a slice through the data in place of the isosurface
    /// Of a slice: lines at these values in place of triangles (.vtp and .obj alone).
    std::vector<double> contours;
    std::optional<double> error;  ///< in units of the data; 0 (the default) = full resolution
    std::optional<double> error_relative;  ///< relative to the data's range
    Guarantee guarantee = Guarantee::deviation;
    /// Any field as stop test in place of error and guarantee: nodes below the threshold stop.
    std::optional<Field> stop;
    double threshold = 0;  ///< in the field's own units
    bool threshold_relative =
        false;                     ///< threshold is a fraction of the field's largest finite value
    std::optional<Field> bound;    ///< for the interest test; the tightest there is unless given
    std::optional<Double3> view;   ///< drop backfaces for a viewer who looks in this direction
    std::optional<Field> cull_by;  ///< normal_turn_plus or grad_linf_plus; whichever there is
    std::optional<Focus> focus;
    std::optional<Camera> camera;
    bool normals = false;                 ///< vertex normals from the data's gradient
    std::optional<Field> vertex_error;    ///< this field at the vertices
    const StoreReader* values = nullptr;  ///< vertex values from this store, of the same nodes
    std::optional<WorldBox> box;          ///< the surface is cut at the box
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most
    int threads = 0;                                 ///< 0 = all cores
    bool force = true;                               ///< replace an existing mesh file
};

struct ExtractReport {
    int dimension = 3;  ///< of the lattice; 2: triangles and lines in place of tetrahedra
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    double tolerance = 0;  ///< the error asked for, in units of the data
    /// Largest indicator at which a visited leaf stopped; of a slice, its contours and a graph with
    /// value_rounding on top.
    double error_bound = 0;
    /// Most by which a value of a vertex, or a graph's height, is off because it was rounded, in
    /// units of the data.
    double value_rounding = 0;
    double value_range = 0;  ///< of the store that values and heights are taken from
    Field stop = Field::deviation_bar;
    Field bound = Field::deviation_bar;
    std::optional<Field> culled_by;
    std::uint64_t visited_tetrahedra = 0;
    std::uint64_t leaf_tetrahedra = 0;      ///< visited, not refined further, and holding surface
    std::uint64_t zero_area_triangles = 0;  ///< left where coordinates round to the same place
    /// Most by which a coordinate is rounded to float32, in distances of neighbouring nodes: on top
    /// of the error.
    double coordinate_rounding = 0;
    std::uint64_t chunks_read = 0;
    std::uint64_t chunks_total = 0;
    std::uint64_t bytes_read = 0;  ///< stored bytes of the chunks read
    std::uint64_t peak_cache_bytes = 0;
    std::uint64_t bricks = 0;
    double seconds = 0;
};

/// Writes the isosurface {U = iso}, or a slice, in the format that the name of `mesh` ends with
/// (see mesh_writer.h), coordinates float32 in world units, triangles facing smaller values (a
/// slice: against its normal). Values at vertices are float32 where that holds the store's values,
/// else float64; .glb has float32 alone, and value_rounding says what that costs. Of a store with
/// one flat axis, {U = iso} are lines, and the graph is a surface facing up. A slice's vertices,
/// and those of its contour lines, have the value. The bytes depend on the volume and on what is
/// asked for, not on memory and threads. An empty surface is a mesh without triangles. Throws
/// Error{invalid_argument} (non-finite iso, negative error), Error{not_found} (the store lacks the
/// field that the guarantee needs), Error{limit} (memory, or more than 2^32 - 1 vertices),
/// Error{corrupt, io, cancelled}. Thread-safe for different outputs.
ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                      const ExtractOptions& options, Progress& progress);

}  // namespace isonest::detail
