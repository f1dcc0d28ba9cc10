// Queries in lattice terms: one form for all products.
#pragma once

#include <algorithm>
#include <filesystem>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/extract.h>
#include <isonest/volume_source.h>

#include "query/apart/keep_apart.h"
#include "query/march/curved_place.h"
#include "query/mesh/part_store.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/patch.h"
#include "query/traverse/traversal.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Converts a plane from the world to the volume's own axes, which are rotated about its origin.
WorldPlane in_own_axes(const WorldPlane& plane, const StoreHeader& header);

/// What is extracted.
enum class Product : std::uint8_t { surface, isolines, slice, contours, graph };

/// The distance within which a surface is simplified.
struct DistanceChoice {
    double within = 0;                       ///< world units; 0 = not simplified
    std::optional<std::uint64_t> triangles;  ///< maximum number of triangles, if limited
    Effort effort = Effort::best;
    bool is_any = false;  ///< it exceeds the distance of any two points of the volume
};

/// Processing of the whole mesh, in addition to closing it (traversal.box.close).
struct StageChoice {
    std::optional<ComponentChoice> components;
    std::optional<DistanceChoice> distance;
    std::optional<double> error;  ///< the error for the simplification, in units of the data; > 0
    Effort error_effort = Effort::best;  ///< effort for the error
    bool manifold = false;               ///< see SurfaceStages; done on the way to the sink

    /// Whether there is work in addition to mending.
    [[nodiscard]] bool any() const { return components || simplifies() || error; }
    /// Whether it is simplified within a distance.
    [[nodiscard]] bool simplifies() const { return distance && distance->within > 0; }
};

/// The position of a mesh, and its accuracy.
struct MeshPlace {
    WorldLattice lattice;
    ClipBox box;            ///< to which the surface is clipped
    double rounding = 0;    ///< of coordinates, as in the report
    bool has_faces = true;  ///< the box's faces are planes; false for a curvilinear grid

    /// The smallest distance between neighbouring nodes, world units.
    [[nodiscard]] double voxel() const { return lattice.steps.shortest(); }
    /// Maximum error of a vertex position, world units.
    [[nodiscard]] double max_moved() const;
    /// The faces of a box between nodes (or of the box to which the surface is clipped) in the same
    /// form as vertices: world coordinates, float32.
    /// None if they are not planes.
    [[nodiscard]] PatchBox faces_of(const ClipBox& of) const;
    [[nodiscard]] PatchBox faces() const { return faces_of(box); }
};

/// A query in the volume's own axes: in these it is not rotated, and its mesh is rotated into the
/// world by RotatedSink.
struct ExtractQuery {
    Product product = Product::surface;
    TraversalQuery traversal;
    double threshold = 0;  ///< for the stop field, in its own units
    double tolerance = 0;  ///< as in the report
    /// For a surface: the distance at which elements of the nested grid stop, world units; > 0.
    std::optional<double> nested_distance;
    /// Use the values of a LabelView instead of the store's.
    std::optional<LabelChoice> label;
    /// The traversal's box before it was restricted to the extent of the label, if it was.
    std::optional<ClipBox> asked_box;
    std::vector<double> contours;  ///< values of contour lines
    double graph_scale = 1;        ///< for a graph
    /// For the mesh, in own axes: world coordinates are origin + steps.vector(position).
    LatticeSteps steps = {};
    Double3 origin{};
    /// Curvilinear grids: nodes of a lattice with these steps and this origin that contains all
    /// positions. It replaces the grid after vertices have been placed (CurvedPlace).
    std::optional<Int3> around = {};
    double coordinate_rounding = 0;    ///< as in the report
    std::optional<Rotation> rotation;  ///< for a volume that is not aligned with the world's axes
    double min_apart = kMinApart;      ///< smallest step for separating vertices
    bool moves_apart = true;           ///< whether vertices at the same place are separated
    const StoreReader* values = nullptr;  ///< source of vertex values, if not the store
    StageChoice stages;
    /// The folder of a kept analysis, if requested.
    std::optional<std::filesystem::path> analysis_folder;

    /// Number of corners of an element.
    [[nodiscard]] int corners() const {
        return product == Product::isolines || product == Product::contours ? 2 : 3;
    }
    /// Whether no two vertices may be at the same place.
    [[nodiscard]] bool keeps_apart() const {
        return product == Product::surface || product == Product::slice;
    }
    /// Whether ranks share the traversal: for surfaces of values or of a label, and slices and
    /// contours of volumes. Not for data in a plane, nor for surfaces whose elements stop at a
    /// distance (every rank would need the distances of all).
    [[nodiscard]] bool is_shared() const {
        return !nested_distance && product != Product::isolines && product != Product::graph;
    }
    /// The store of vertex values.
    [[nodiscard]] const StoreReader& values_in(const StoreReader& store) const {
        return values != nullptr ? *values : store;
    }
    /// What the threads of its traversal need.
    [[nodiscard]] TraversalHeap heap(const StoreLayout& layout) const {
        return {layout, traversal, values != nullptr ? &values->layout() : nullptr};
    }
    /// The place of the mesh, for an extraction from a volume of this many nodes.
    [[nodiscard]] MeshPlace place(const Int3& nodes) const {
        return {{origin, steps, around.value_or(nodes)},
                asked_box.value_or(traversal.box),
                coordinate_rounding,
                !around};
    }
    /// Lets the parts of the mesh record which vertices may be at the same place, if those are
    /// separated, and which have no normal, if normals are requested.
    void watch(PartStore& parts) const;
    /// How parts of a curvilinear grid are placed.
    [[nodiscard]] CurvedPlacing placing() const;
    /// How vertices at the same place are separated, without the faces and the box that limit them.
    [[nodiscard]] ApartRange apart_range() const;
    /// As in the report.
    [[nodiscard]] std::optional<double> asked_distance() const {
        return nested_distance   ? nested_distance
               : stages.distance ? std::optional(stages.distance->within)
                                 : std::nullopt;
    }
};

/// All memory that a call may use, for a store or volume of this name.
MemoryShare memory_of(const ExtractOptions& options, const std::string& name);

/// The bounding box of a box's corners, each mapped by map(p).
template <class Map>
std::pair<Double3, Double3> bounds_of_box(const Double3& lo, const Double3& hi, const Map& map) {
    constexpr double kMax = std::numeric_limits<double>::infinity();
    std::pair<Double3, Double3> bounds{{kMax, kMax, kMax}, {-kMax, -kMax, -kMax}};
    for (unsigned corner = 0; corner < 8; ++corner) {
        Double3 p{};
        for (std::size_t a = 0; a < 3; ++a) {
            p[a] = (corner >> a & 1U) != 0 ? hi[a] : lo[a];
        }
        p = map(p);
        for (std::size_t a = 0; a < 3; ++a) {
            bounds.first[a] = std::min(bounds.first[a], p[a]);
            bounds.second[a] = std::max(bounds.second[a], p[a]);
        }
    }
    return bounds;
}

/// In world units; voxels are the smallest distances between neighbouring nodes.
double world_distance(const StoreHeader& header, const DistanceBound& asked);

/// The distance of a stop. Without one, a number of triangles is within any distance.
DistanceChoice distance_choice(const StoreHeader& header, const DistanceStop& stop, Effort effort);

/// The rest of a distance, world units, if float32 moves vertices by up to `moved`. `name`: of the
/// store. Throws Error{limit} if nothing is left.
double distance_left(const std::string& name, double distance, double moved);

/// Converts queries, and rejects those that are invalid for this store. A focus that is a box
/// becomes the smallest box along the volume's own axes that contains it. `float64`: whether the
/// mesh supports it. Throws Error{invalid_argument, not_found, limit} as extract() does, and
/// Error{unsupported} for what cannot be rotated: boxes, graphs. REQUIRES: the stop of a surface is
/// not a TriangleBudgetByError.
ExtractQuery extract_query(const StoreReader& store, const SurfaceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const LabelQuery& query, bool float64);
/// For a volume without a store.
ExtractQuery extract_query(const VolumeDescription& volume, const SurfaceQuery& query);
ExtractQuery extract_query(const StoreReader& store, const SliceQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const ContourQuery& query, bool float64);
ExtractQuery extract_query(const StoreReader& store, const GraphQuery& query, bool float64);

}  // namespace isonest::detail
