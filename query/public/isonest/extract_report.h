// What an extraction did, stage by stage, and what is known of its mesh.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/field.h>
#include <isonest/world.h>

namespace isonest {

/// What the traversal of the nested grid did.
struct TraversalReport {
    Field stop = Field::deviation_bar;   ///< the field of the stop test
    Field bound = Field::deviation_bar;  ///< of the interest test
    std::optional<Field> culled_by;
    Cells cells = Cells::tetrahedra;  ///< of the nested grid
    std::uint64_t visited = 0;        ///< of the cells; in a plane triangles or squares
    std::uint64_t leaves = 0;         ///< visited, not refined further, holding surface or cap
    std::uint64_t bricks = 0;         ///< units of work
    std::uint64_t chunks_read = 0;    ///< by this call alone, those read twice counted twice
    std::uint64_t chunks_total = 0;   ///< of the store
    std::uint64_t bytes_read = 0;     ///< stored bytes of the chunks read
    std::uint64_t peak_cache_bytes = 0;
};

struct ClosingReport {
    Outside outside = Outside::below;  ///< as in the query
    /// Vertices on borders that are left, around missing values.
    std::uint64_t border_vertices = 0;
};

/// Triangles that had no area since coordinates are rounded to float32.
struct MendingReport {
    std::uint64_t mended = 0;  ///< taken out, or changed so that they have one
    /// Nothing helped; of a volume that is turned against the world's axes, once it is turned.
    std::uint64_t zero_area = 0;
};

/// Vertices of different sheets that were in one place.
struct ApartReport {
    std::uint64_t moved = 0;     ///< so that they are not any more
    std::uint64_t together = 0;  ///< nothing helped
};

struct ComponentReport {
    std::uint64_t components = 0;         ///< that there are
    std::uint64_t dropped = 0;            ///< of them
    std::uint64_t dropped_triangles = 0;  ///< or lines; as extracted
    std::uint64_t largest_dropped = 0;    ///< triangles (or lines) of the largest of them
};

/// Of a mesh of triangles, as its coordinates are; the same for any threads and memory.
struct SurfaceMeasures {
    double area = 0;  ///< square world units
    /// Within a closed mesh, cubic world units: of the space that its triangles face away from or,
    /// if the rest of space is that, of the space that they face. A void in a solid counts
    /// negative. Nothing if the mesh has a border: an edge that triangles pass more often in one
    /// direction than in the other; by a checksum that misses one with a probability below 2^-50.
    std::optional<double> volume = {};
};

/// Between which volumes one is proven to lie, cubic world units, 0 <= least <= most.
struct VolumeInterval {
    double least = 0;
    double most = 0;
};

/// Of a mesh that was to be within a distance of the surface at full resolution.
struct DistanceReport {
    double asked = 0;  ///< within which the mesh was to be, in world units
    /// Proven: at most `asked`. Coordinates rounded to float32 count in.
    double bound = 0;
    /// Triangles (or lines) of the surface at full resolution, with all its components, if it was
    /// simplified.
    std::uint64_t full_triangles = 0;
    /// Of the surface that the distance is from, without components that were dropped, if it has
    /// triangles and was simplified by this call (not in a kept analysis).
    std::optional<SurfaceMeasures> full = {};
};

/// A label that another one touches, whichever components are dropped.
struct NeighbourLabel {
    std::int64_t id = 0;
    /// Of the triangles that the whole meshes of the two share, square world units.
    double area = 0;
};

/// Of a label's mesh that was smoothed.
struct SmoothReport {
    int passes = 0;  ///< as in the query
    /// Proven: no point of the mesh is further from the label's staircase, the faces of its voxels,
    /// and no point of the staircase further from the mesh, in world units; less than half a cell's
    /// diagonal, and where it was simplified the distance's bound more. Coordinates rounded to
    /// float32 count in. The staircase is without those parts whose components were dropped.
    double bound = 0;
    /// Proven: all nodes further than this from the surfaces between labels, world units, are
    /// inside the meshes of their own labels alone; 0: all nodes. Above 0 for a mesh that was
    /// simplified without LabelSmoothing::keep_nodes: the distance's bound.
    double nodes_beyond = 0;
    std::vector<NeighbourLabel> neighbours = {};  ///< by their ids
};

/// The surface between two labels.
struct LabelInterface {
    std::int64_t behind = 0;    ///< the smaller label
    std::int64_t in_front = 0;  ///< the larger one, or InterfaceReport::outside
    double area = 0;            ///< square world units
};

/// Of the mesh of all interfaces between labels.
struct InterfaceReport {
    std::uint64_t interfaces = 0;  ///< how many pairs share an area
    /// What the mesh calls that which has no label: nodes without a value, and what is beyond the
    /// volume. -1, or if a label of the store is negative the smallest one less 1.
    std::int64_t outside = -1;
};

/// Of a mesh that was simplified within an error.
struct ErrorSimplificationReport {
    std::uint64_t nested_triangles = 0;  ///< of the nested grid, with all components
};

/// What was done with a kept analysis.
enum class AnalysisUse : std::uint8_t {
    made,
    found,
    replaced_stale,    ///< of another store, or made by another version
    replaced_damaged,  ///< its checksums do not agree
    not_used           ///< the distance is too small, or the number of triangles too large
};

struct AnalysisReport {
    AnalysisUse use = AnalysisUse::not_used;
    std::filesystem::path file = {};  ///< empty if it was not used
};

/// The smallest angles of a mesh's triangles, degrees, 0 ... 60. Quantiles are rounded down to a
/// hundredth.
struct TriangleQuality {
    static constexpr double kNarrow = 5;  ///< degrees

    double least = 0;         ///< not rounded
    double per_mille = 0;     ///< one in a thousand triangles has a smaller one
    double percent = 0;       ///< one in a hundred
    double five_percent = 0;  ///< one in twenty
    double median = 0;
    double narrow_share = 0;  ///< of the triangles, those with an angle below kNarrow; 0 ... 1
};

/// The stages that were asked for have reports of their own; the others have none.
struct ExtractReport {
    int dimension = 3;  ///< of the lattice; 2: triangles and lines in place of tetrahedra
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;  ///< or lines
    double tolerance = 0;         ///< the error or threshold asked for, not as a fraction
    /// Largest indicator at which a visited leaf stopped, or, if the mesh was simplified within an
    /// error, that the proof met; of a slice, its contours and a graph with value_rounding on top.
    /// With exact vertices twice that indicator: a leaf's linear function is within the error of
    /// the isovalue at the triangle's corners, hence on all of it, and the data are within the
    /// error of that function.
    double error_bound = 0;
    /// Most by which a value of a vertex, or a graph's height, is off because it was rounded, in
    /// units of the data.
    double value_rounding = 0;
    double value_range = 0;  ///< of the store that values and heights are taken from
    /// Most by which a coordinate is off, in distances of neighbouring nodes: on top of the error.
    /// It is rounded to float32, and a few may be moved to give triangles an area, and to keep
    /// sheets apart that touch.
    double coordinate_rounding = 0;
    /// Whether a mesh has no more triangles than asked for. (An ErrorBudget that cannot be met is
    /// an error; the error that was found is `tolerance`.)
    std::optional<bool> within_budget = {};

    TraversalReport traversal = {};
    std::optional<ClosingReport> closing = {};
    MendingReport mending = {};
    ApartReport apart = {};
    std::optional<ComponentReport> components = {};
    std::optional<DistanceReport> distance = {};
    std::optional<ErrorSimplificationReport> simplified_error = {};
    std::optional<SmoothReport> smooth = {};
    std::optional<InterfaceReport> interfaces = {};
    std::optional<AnalysisReport> analysis = {};
    /// If the mesh has triangles as elements.
    std::optional<SurfaceMeasures> measures = {};
    /// If it was asked for and nothing was left open at missing values: of the volume at full
    /// resolution.
    std::optional<VolumeInterval> volume_interval = {};
    /// If it was asked for, and the mesh has triangles as elements.
    std::optional<TriangleQuality> quality = {};

    std::uint64_t scratch_bytes = 0;  ///< of temporary files at a time, at most
    double seconds = 0;
};

}  // namespace isonest
