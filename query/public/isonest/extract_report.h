// Reports of an extraction, stage by stage, and the known properties of its mesh.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/field.h>
#include <isonest/world.h>

namespace isonest {

/// Traversal of the nested grid.
struct TraversalReport {
    Field stop = Field::deviation_bar;   ///< the field of the stop test
    Field bound = Field::deviation_bar;  ///< the field of the interest test
    std::optional<Field> culled_by;
    Cells cells = Cells::tetrahedra;  ///< of the nested grid
    std::uint64_t visited = 0;        ///< cells visited; in a plane, triangles or squares
    std::uint64_t leaves = 0;         ///< cells visited but not refined further that contain
                                      ///< surface or cap
    std::uint64_t bricks = 0;         ///< units of work
    std::uint64_t chunks_read = 0;    ///< by this call alone; chunks read twice count twice
    std::uint64_t chunks_total = 0;   ///< in the store
    std::uint64_t bytes_read = 0;     ///< stored size of the chunks read
    std::uint64_t peak_cache_bytes = 0;
};

struct ClosingReport {
    Outside outside = Outside::below;  ///< as in the query
    /// Remaining vertices on borders, around missing values.
    std::uint64_t border_vertices = 0;
};

/// Repair of triangles that lost their area when coordinates were rounded to float32.
struct MendingReport {
    std::uint64_t mended = 0;  ///< removed, or changed so that they have an area
    /// Could not be repaired. For a volume rotated relative to the world's axes: after the
    /// rotation.
    std::uint64_t zero_area = 0;
};

/// Separation of vertices of different sheets at the same position.
struct ApartReport {
    std::uint64_t moved = 0;     ///< vertices moved apart
    std::uint64_t together = 0;  ///< could not be separated
};

/// Where a mesh of triangles is not a manifold with border.
struct ManifoldReport {
    /// Edges with more than two triangles: where a label touches itself along an edge of its
    /// voxels.
    std::uint64_t edges = 0;
    /// Vertices where triangles meet that no chain of common edges around the vertex connects.
    std::uint64_t vertices = 0;
    /// With SurfaceStages::manifold: vertices that were added to separate these places. The mesh
    /// that is written then has none.
    std::uint64_t copies = 0;
};

struct ComponentReport {
    std::uint64_t components = 0;         ///< before dropping
    std::uint64_t dropped = 0;            ///< number of components dropped
    std::uint64_t dropped_triangles = 0;  ///< their triangles (or lines), as extracted
    std::uint64_t largest_dropped = 0;    ///< triangles (or lines) of the largest dropped component
};

/// Measures of a mesh of triangles, from its final coordinates. They do not depend on threads or
/// memory.
struct SurfaceMeasures {
    double area = 0;  ///< square world units
    /// Enclosed volume of a closed mesh, cubic world units: of the space behind its triangles or,
    /// if that is the unbounded part, of the space in front of them. A void in a solid counts as
    /// negative. Nothing if the mesh has a border: an edge that triangles use more often in one
    /// direction than in the other. Borders are detected by a checksum that misses one with a
    /// probability below 2^-50.
    std::optional<double> volume = {};
};

/// An interval proven to contain the volume, cubic world units, 0 <= least <= most.
struct VolumeInterval {
    double least = 0;
    double most = 0;
};

/// For a mesh that was requested within a distance of the surface at full resolution.
struct DistanceReport {
    double asked = 0;  ///< requested distance, in world units
    /// Proven distance: at most `asked`. Includes the rounding of coordinates to float32.
    double bound = 0;
    /// If the surface was simplified: triangles (or lines) of the surface at full resolution, with
    /// all its components.
    std::uint64_t full_triangles = 0;
    /// Measures of the surface from which the distance is measured, without dropped components.
    /// Present if it has triangles and was simplified by this call (not in a kept analysis).
    std::optional<SurfaceMeasures> full = {};
};

/// A label that touches the label of the mesh, regardless of dropped components.
struct NeighbourLabel {
    std::int64_t id = 0;
    /// Area of the triangles shared by the complete meshes of the two labels, square world units.
    double area = 0;
};

/// For a smoothed mesh of a label.
struct SmoothReport {
    int passes = 0;  ///< as in the query
    /// Proven maximum distance, in both directions, between the mesh and the label's staircase (the
    /// faces of its voxels), in world units. Less than half the diagonal of a cell; if the mesh was
    /// simplified, plus the bound of the distance. Includes the rounding of coordinates to float32.
    /// The staircase excludes the parts whose components were dropped.
    double bound = 0;
    /// Proven: all nodes further than this from the surfaces between labels (world units) are
    /// inside the mesh of their own label and no other; 0: all nodes. It is above 0, namely the
    /// bound of the distance, for a mesh that was simplified without LabelSmoothing::keep_nodes.
    double nodes_beyond = 0;
    std::vector<NeighbourLabel> neighbours = {};  ///< sorted by id
};

/// The surface between two labels.
struct LabelInterface {
    std::int64_t behind = 0;    ///< the smaller label
    std::int64_t in_front = 0;  ///< the larger one, or InterfaceReport::outside
    double area = 0;            ///< square world units
};

/// For the mesh of all interfaces between labels.
struct InterfaceReport {
    std::uint64_t interfaces = 0;  ///< number of pairs that share an area
    /// The number that stands for unlabelled space in the mesh: nodes without a value, and
    /// everything outside the volume. It is -1 or, if the store has negative labels, the smallest
    /// one minus 1.
    std::int64_t outside = -1;
};

/// For a mesh that was simplified within an error.
struct ErrorSimplificationReport {
    /// Triangles before simplification, with all components: of the nested grid, or of hexahedra at
    /// full resolution.
    std::uint64_t nested_triangles = 0;
    /// For hexahedra. Proven: on every triangle of the mesh that is unchanged from the surface at
    /// full resolution, except caps, the trilinear function differs from the isovalue by at most
    /// this. On all other triangles it is within error_bound. Infinite: unknown because of missing
    /// values.
    std::optional<double> full_bound = {};
};

/// How a kept analysis was used.
enum class AnalysisUse : std::uint8_t {
    made,
    found,
    replaced_stale,    ///< of another store or version
    replaced_damaged,  ///< its checksums do not match
    not_used           ///< the distance is too small, or the triangle budget too large
};

/// The name used in reports, for example "made" or "replaced_stale".
constexpr const char* name_of(AnalysisUse use) {
    switch (use) {
        case AnalysisUse::made:
            return "made";
        case AnalysisUse::found:
            return "found";
        case AnalysisUse::replaced_stale:
            return "replaced_stale";
        case AnalysisUse::replaced_damaged:
            return "replaced_damaged";
        case AnalysisUse::not_used:
            break;
    }
    return "not_used";
}

struct AnalysisReport {
    AnalysisUse use = AnalysisUse::not_used;
    std::filesystem::path file = {};  ///< empty if not used
};

/// Distribution of the triangles' smallest angles, in degrees, 0 ... 60. Quantiles are rounded down
/// to a hundredth.
struct TriangleQuality {
    static constexpr double kNarrow = 5;  ///< degrees

    double least = 0;         ///< smallest angle, not rounded
    double per_mille = 0;     ///< one in a thousand triangles has a smaller angle
    double percent = 0;       ///< one in a hundred
    double five_percent = 0;  ///< one in twenty
    double median = 0;
    double narrow_share = 0;  ///< share of triangles with an angle below kNarrow; 0 ... 1
};

/// The result of an extraction. Optional reports are present if their stage was requested.
struct ExtractReport {
    int dimension = 3;  ///< of the lattice; 2: triangles and lines instead of tetrahedra
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;  ///< for isolines and contours: number of line segments
    double tolerance = 0;         ///< requested error or threshold, as an absolute value
    /// Guaranteed error. Normally the largest indicator of a visited leaf. If the mesh was
    /// simplified within an error, the largest indicator found by the proof (for hexahedra, see
    /// ErrorSimplificationReport). For a slice, its contours and a graph, plus value_rounding. With
    /// exact vertices, twice that indicator: a leaf's linear function is within the error of the
    /// isovalue at the triangle's corners, hence on the whole triangle, and the data are within the
    /// error of that function. Includes data_tolerance.
    double error_bound = 0;
    /// The largest amount by which values were rounded when the store was made; 0: none were.
    /// Distances, areas, volumes and values are those of the rounded values; the interval of the
    /// volume is for the given ones.
    double data_tolerance = 0;
    /// Maximum rounding error of a vertex value or of a graph's height, in units of the data.
    double value_rounding = 0;
    double value_range = 0;  ///< range of the store that provides values and heights
    /// Maximum error of a coordinate, as a multiple of the distance between neighbouring nodes, in
    /// addition to the error. Coordinates are rounded to float32, and a few vertices may be moved
    /// to give triangles an area or to separate touching sheets.
    double coordinate_rounding = 0;
    /// Whether the mesh has at most the requested number of triangles. (A TriangleBudgetByError
    /// that cannot be met throws an error; the error that was found is in `tolerance`.)
    std::optional<bool> within_budget = {};

    TraversalReport traversal = {};
    std::optional<ClosingReport> closing = {};
    MendingReport mending = {};
    ApartReport apart = {};
    /// Present for smooth labels and with SurfaceStages::manifold; also with
    /// ExtractOptions::quality, except on several ranks. Not for interfaces, where three surfaces
    /// may meet.
    std::optional<ManifoldReport> manifold = {};
    std::optional<ComponentReport> components = {};
    std::optional<DistanceReport> distance = {};
    std::optional<ErrorSimplificationReport> simplified_error = {};
    std::optional<SmoothReport> smooth = {};
    std::optional<InterfaceReport> interfaces = {};
    std::optional<AnalysisReport> analysis = {};
    /// Present if the elements are triangles.
    std::optional<SurfaceMeasures> measures = {};
    /// Interval of the volume at full resolution. Present if requested, and if nothing was left
    /// open at missing values.
    std::optional<VolumeInterval> volume_interval = {};
    /// Present if requested, and if the elements are triangles.
    std::optional<TriangleQuality> quality = {};

    std::uint64_t scratch_bytes = 0;  ///< maximum size of temporary files at any time
    double seconds = 0;
};

}  // namespace isonest
