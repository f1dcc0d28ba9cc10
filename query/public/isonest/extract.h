// From a store to a surface, a slice, contour lines or a graph with a guaranteed error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/labels.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/world.h>

namespace isonest {

/// What an ErrorBound promises.
enum class Guarantee : std::uint8_t {
    deviation,  ///< |U - U^l| <= value, by the deviation indicator: tight
    plus,       ///< the same, by eta+ of the offset indicator: looser, more triangles
    estimate    ///< eta bar of the offset indicator: usually close, no promise
};

/// How far the function that is shown may be from the finest one, anywhere.
struct ErrorBound {
    double value = 0;       ///< >= 0; 0 = full resolution
    bool relative = false;  ///< value is a fraction of the data's range, not in the data's units
    Guarantee guarantee = Guarantee::deviation;
};

/// The same error, kept by fewer triangles: those that the nested grid has within a part of it are
/// simplified as long as the values on all of the new ones are proven to be within all of it. The
/// topology stays that of the nested grid's surface. Of a volume; it goes with neither focus nor
/// camera. Nothing is simplified if the error is 0.
struct SimplifiedErrorBound {
    ErrorBound bound;  ///< its guarantee: deviation or plus
};

/// In place of an error: nodes at which this field of the store is below the value are not refined.
struct FieldThreshold {
    Field field = Field::deviation_bar;
    double value = 0;       ///< >= 0, in the field's own units
    bool relative = false;  ///< value is a fraction of the field's largest finite value
};

using StopTest = std::variant<ErrorBound, FieldThreshold>;

/// How far the mesh of a surface may be from the surface at full resolution, anywhere and in both
/// directions (their Hausdorff distance); the triangles or lines are as few as are found within
/// that.
struct DistanceBound {
    double value = 0;     ///< >= 0; 0 = full resolution
    bool voxels = false;  ///< value is in distances of neighbouring nodes (along the axis where
                          ///< they are nearest), not in world units
};

/// The same distance, kept by elements of the nested grid, which are not simplified: the stop test
/// is the distance of a leaf's triangles, with exact vertices, from the surface at full resolution
/// within the leaf. Elements that the box or the volume's border cuts, and those of more than 32
/// cells along an edge, go on. Of a volume; neither closed, nor culled, nor with a choice of
/// components.
struct NestedDistanceBound {
    DistanceBound bound;
};

/// The smallest distance that is found at which a surface has so few triangles.
struct TriangleBudget {
    std::uint64_t most = 0;  ///< > 0
    /// If a mesh within this distance has more triangles, it is the result.
    std::optional<DistanceBound> within = {};
};

/// The smallest error that is found at which a surface has so few triangles.
struct ErrorBudget {
    std::uint64_t most = 0;  ///< > 0; or lines
    Guarantee guarantee = Guarantee::deviation;
    bool simplified = false;  ///< the mesh is that of a SimplifiedErrorBound, not of an ErrorBound
};

using SurfaceStop = std::variant<ErrorBound, FieldThreshold, DistanceBound, TriangleBudget,
                                 ErrorBudget, SimplifiedErrorBound, NestedDistanceBound>;

/// Leaves out what faces away from a viewer who looks in `direction` (section 5 of the paper).
struct BackfaceCulling {
    Double3 direction{};
    /// normal_turn_plus or grad_linf_plus; whichever the store has.
    std::optional<Field> field = {};
};

/// Which connected components of a surface are kept; two that share a vertex are one. All tests
/// have to be passed; `largest` chooses among those that pass the others. It happens before a
/// distance simplifies: what is measured from is the surface without those that are dropped.
struct ComponentChoice {
    std::uint64_t largest = 0;          ///< only so many, those with most triangles; 0 = all. Of
                                        ///< equally large ones those whose vertices come first
    std::uint64_t least_triangles = 0;  ///< (or lines) as extracted, before a simplification
    /// Of the space within, be it below or above the isovalue, in cubic world units; >= 0. A
    /// component with a border (where the volume, the box or missing values cut it) has no volume
    /// and passes. Of a volume alone.
    double least_volume = 0;
};

/// An analysis of a surface that is kept in a file of its own: meshes of it within distances from
/// an eighth of a voxel to four voxels. The first query that asks for one makes the file, which
/// takes several times as long as the query alone; others of the same surface, whatever their
/// distances and numbers of triangles, are made from these meshes and need the store no more. They
/// have somewhat more triangles than without; distances below an eighth of a voxel are made
/// without. The file is made anew where the store has changed, or where it is damaged.
struct KeptAnalysis {
    std::filesystem::path folder = {};  ///< empty: beside the store
};

/// What was done with a kept analysis.
enum class AnalysisUse : std::uint8_t {
    made,
    found,
    replaced_stale,    ///< of another store, or made by another version
    replaced_damaged,  ///< its checksums do not agree
    not_used           ///< the distance is too small, or the number of triangles too large
};

// What to extract. `focus` and `camera` loosen the stop test with the distance, `box` cuts what is
// extracted at its faces. `vertex_values`: the attribute "value" from another store with the same
// nodes, which has to live as long as the call. `vertex_error`: this field as attribute "error".

/// Nodes with a label; none outside of [low, high] (as find_labels() says) is looked at.
struct LabelChoice {
    std::int64_t id = 0;
    std::optional<std::pair<Int3, Int3>> within = {};
};

/// The surface {U = iso}, triangles that face smaller values; of a store with one flat axis the
/// lines {U = iso}.
struct SurfaceQuery {
    double iso = 0;
    SurfaceStop stop = {};  ///< a distance goes with neither focus nor camera
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    /// By which elements without surface are left out; the tightest that the store has.
    std::optional<Field> bound = {};
    std::optional<BackfaceCulling> culling = {};  ///< of a volume alone
    bool normals = false;                         ///< from the data's gradient
    const Store* vertex_values = nullptr;
    std::optional<Field> vertex_error = {};
    /// Exact ones go with neither `close` nor a distance, whose vertices are exact in any case.
    VertexPlace vertices = VertexPlace::linear;
    /// Hexahedra give about a third of the triangles that tetrahedra give: those of marching cubes,
    /// where the corners of a face on alternate sides keep the values below the isovalue apart.
    /// Cells with a missing corner have no surface. An error, or the threshold of a field of cells,
    /// needs that field (hex_deviation, hex_linf for an estimate), and bounds how far the data are
    /// from the function whose surface is shown, which is trilinear in each cell. Of a volume
    /// alone, for one error everywhere, neither closed nor culled, with linear vertices.
    Cells cells = Cells::tetrahedra;
    /// Drops specks; without a value components are not looked for.
    std::optional<ComponentChoice> components = {};
    /// Closes the surface by caps where it meets the faces of the volume or of the box, so that
    /// every edge has two triangles; only at missing values it stays open. The caps face as the
    /// surface does: out of the solid with Outside::below, into it with Outside::above. Where nodes
    /// near those faces have the isovalue exactly, triangles without area arise, and are mended. Of
    /// a volume alone; not together with `culling`.
    std::optional<Outside> close = {};
    /// Of a volume alone, with a DistanceBound or TriangleBudget, without `culling`.
    std::optional<KeptAnalysis> analysis = {};
    /// In place of an isovalue: the surface around the nodes that have this label. It lies half way
    /// between them and the others, at full resolution, or within a distance from that. Of a volume
    /// alone; with neither an error, focus, camera, `culling`, exact vertices nor `analysis`.
    std::optional<LabelChoice> label = {};
};

/// The part of a plane inside the volume, triangles that face against its normal and have the
/// attribute "value".
struct SliceQuery {
    WorldPlane plane = {};
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    bool normals = false;  ///< from the data's gradient
    const Store* vertex_values = nullptr;
    std::optional<Field> vertex_error = {};
    Cells cells = Cells::tetrahedra;  ///< as in SurfaceQuery
};

/// The lines in a plane on which the data have one of `values` (at most 1000), with the attribute
/// "value".
struct ContourQuery {
    WorldPlane plane = {};
    std::vector<double> values = {};
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
};

/// Of a store with one node along z: the surface z = scale U, facing up.
struct GraphQuery {
    double scale = 1;
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    bool normals = false;  ///< of the graph
    const Store* vertex_values = nullptr;
    std::optional<Field> vertex_error = {};
    /// hexahedra: quadrilaterals, written as triangles; the bound is one for the function that is
    /// bilinear in each. With neither focus nor camera.
    Cells cells = Cells::tetrahedra;
};

struct ExtractOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most, beside the sink's
    int threads = 0;                                 ///< 0 = all cores
    /// Where what does not fit into the memory goes, in files without names; empty = the system's
    /// folder for temporary files.
    std::filesystem::path scratch = {};
    bool quality = false;  ///< the report says which angles the triangles have
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
    Field stop = Field::deviation_bar;
    Field bound = Field::deviation_bar;
    std::optional<Field> culled_by;
    std::uint64_t visited_tetrahedra = 0;  ///< or hexahedra
    /// Visited, not refined further, and holding surface or cap.
    std::uint64_t leaf_tetrahedra = 0;
    /// Triangles that had no area since coordinates are rounded to float32: those that were taken
    /// out, or changed so that they have one, and those that nothing helped.
    std::uint64_t mended_triangles = 0;
    std::uint64_t zero_area_triangles = 0;
    /// If it was asked for, and the mesh has triangles as elements.
    std::optional<TriangleQuality> quality = {};
    /// Most by which a coordinate is off, in distances of neighbouring nodes: on top of the error.
    /// It is rounded to float32, and a few may be moved to give triangles an area.
    double coordinate_rounding = 0;
    /// If a distance or a number of triangles was asked for: the distance within which the mesh was
    /// to be, in world units.
    std::optional<double> distance = {};
    /// If a number of triangles was asked for: whether the mesh has no more. (An ErrorBudget that
    /// cannot be met is an error; the error that was found is `tolerance`.)
    std::optional<bool> within_budget = {};
    /// Proven: at most `distance`. Coordinates rounded to float32 count in.
    double distance_bound = 0;
    /// Triangles (or lines) of the surface at full resolution, with all its components.
    std::uint64_t full_triangles = 0;
    /// If it was simplified within an error: triangles of the nested grid before, with all
    /// components.
    std::uint64_t nested_triangles = 0;
    /// If components were asked for: how many there are, and what was dropped.
    std::uint64_t components = 0;
    std::uint64_t dropped_components = 0;
    std::uint64_t dropped_triangles = 0;  ///< or lines; as extracted
    std::uint64_t largest_dropped = 0;    ///< triangles (or lines) of the largest of them
    std::optional<Outside> closed = {};   ///< as in the query
    /// If it was closed: vertices of the surface, as extracted, on borders that are left, around
    /// missing values.
    std::uint64_t border_vertices = 0;
    std::optional<AnalysisUse> analysis = {};  ///< if one was asked for
    std::filesystem::path analysis_file = {};
    std::uint64_t scratch_bytes = 0;  ///< of temporary files of what changes the whole mesh
    std::uint64_t chunks_read = 0;    ///< by this call alone, those read twice counted twice
    std::uint64_t chunks_total = 0;   ///< of the store
    std::uint64_t bytes_read = 0;     ///< stored bytes of the chunks read
    std::uint64_t peak_cache_bytes = 0;
    std::uint64_t bricks = 0;
    double seconds = 0;
};

/// Hands the mesh to `sink`: coordinates float32 in world units; values float32 where that holds
/// the store's values, else float64 if the sink holds it. The mesh depends on the volume and on the
/// query, not on memory and threads. Nothing there is a mesh without elements, not an error.
/// Throws Error{invalid_argument} (a query that makes no sense, or none for this store),
/// Error{not_found} (the store lacks the field that the stop test needs), Error{limit} (memory, or
/// numbers beyond float32), Error{corrupt, io, cancelled}, and what the sink throws.
/// Thread-safety: any number of calls at once, with different sinks, also on one store.
ExtractReport extract(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const SliceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const ContourQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const GraphQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// The surfaces of labels (as of find_labels()), a mesh each, that extract() makes with query.label
/// set to them; several at a time, which share the memory and the threads. `sink` and `done` are
/// called from many threads, with a label and with its number in `labels`. Throws as extract(): the
/// meshes that are finished stay.
void extract_labels(const Store& store, std::span<const Label> labels, const SurfaceQuery& query,
                    const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
