// Extracts a surface, a slice, contour lines or a graph from a store, with a guaranteed error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/labels.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>
#include <isonest/stop.h>
#include <isonest/store.h>
#include <isonest/surface_stages.h>
#include <isonest/world.h>

namespace isonest {
namespace detail {
struct RankTeam;
}

/// Omits surface that faces away from a viewer looking in `direction` (section 5 of the paper).
struct BackfaceCulling {
    Double3 direction{};
    /// normal_turn_plus or grad_linf_plus; by default whichever the store has.
    std::optional<Field> field = {};
};

// Queries: what to extract. `focus` and `camera` loosen the stop test with the distance; `box`
// clips the result at its faces. Options that cannot be combined are listed in one table (shown in
// tools/MANUAL.md); extract() rejects them.

/// Numbers stored with each vertex, besides its position.
struct MeshAttributes {
    bool normals = false;  ///< unit length, along the gradient; for graphs and slices, of the
                           ///< surface
    /// Source of the attribute "value": another store with the same nodes. It must outlive the
    /// call.
    const Store* values = nullptr;
    std::optional<Field> error = {};  ///< field to write as the attribute "error"
};

/// Which elements of the nested grid are visited, and how vertices are placed in its leaves.
struct NestedGrid {
    /// Type of the elements. Hexahedra give about a third as many triangles as tetrahedra: those of
    /// marching cubes. Ambiguous faces (corners above and below alternate) separate the values
    /// below the isovalue. Cells with a missing corner contain no surface. An error, or a threshold
    /// on a field of cells, needs that field in the store (hex_deviation; hex_linf for an
    /// estimate). It then bounds the difference between the data and the function whose surface is
    /// shown, which is trilinear in each cell.
    ///
    /// Default: at full resolution hexahedra, simplified or not, unless the query contains
    /// something that needs tetrahedra. Within an error: hexahedra if the surface is simplified and
    /// this reads no more of the store than the nested grid of tetrahedra.
    std::optional<Cells> cells = {};
    VertexPlace vertices = VertexPlace::linear;  ///< always exact for a distance
    /// Field by which elements without surface are skipped; default: the tightest in the store.
    std::optional<Field> bound = {};
    std::optional<BackfaceCulling> culling = {};
};

/// The surface {U = iso}. Triangles face smaller values. For a store with one flat axis, the lines
/// {U = iso}.
struct SurfaceQuery {
    double iso = 0;
    SurfaceStop stop = {};
    /// How the mesh is simplified. Default: best, if there is an error above 0, a distance or a
    /// triangle budget, and the query has nothing that a simplified mesh does not support (a focus,
    /// a camera, an estimate); otherwise none.
    std::optional<Effort> effort = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    NestedGrid grid = {};
    MeshAttributes attributes = {};
    SurfaceStages stages = {};
    std::optional<KeptAnalysis> analysis = {};  ///< for a DistanceBound or TriangleBudgetByDistance
    /// Report an interval that contains the volume of the closed solid at full resolution. This
    /// extracts two additional surfaces, which are discarded.
    bool volume_interval = false;
};

/// The nodes with a label. Nodes outside [low, high] (as reported by find_labels()) are ignored.
struct LabelChoice {
    std::int64_t id = 0;
    std::optional<std::pair<Int3, Int3>> within = {};
};

/// Surface nets instead of surfaces half way between nodes. Adjacent labels share them. Vertices
/// are moved repeatedly towards the mean of their neighbours, but never leave their cells. All
/// labels of the store shape the meshes, including those that are not requested.
///
/// Guaranteed: every node of the volume lies inside the mesh of its own label and inside no other;
/// SmoothReport::bound holds; where two labels touch, both meshes have the same vertices and the
/// same triangles, with opposite orientation.
///
/// Every edge of a mesh has two triangles, except where a label touches itself along an edge of its
/// voxels: there it has four (ManifoldReport::edges), unless SurfaceStages::manifold is set. At the
/// volume's border, half a node spacing beyond the last nodes, meshes are open, or closed with
/// SurfaceStages::close. Dropping components does not change the others: the nodes of a dropped
/// component lie inside no mesh or, if it was a cavity, also inside the mesh around it.
struct LabelSmoothing {
    static constexpr int kMaxPasses = 64;
    [[deprecated("now called kMaxPasses")]] static constexpr int kMostPasses = kMaxPasses;
    /// Number of smoothing passes, 0 ... kMaxPasses; 0 gives the faces of the voxels.
    int passes = 16;
    /// For meshes simplified within a distance. True: no node changes sides, whatever the distance.
    /// False: only nodes within the distance of the surfaces may change sides.
    bool keep_nodes = false;
};

/// The surface around the nodes with a label, half way between them and the other nodes. Volumes
/// only.
struct LabelQuery {
    LabelChoice label = {};
    std::optional<DistanceStop> stop = {};  ///< default: full resolution
    std::optional<Effort> effort = {};      ///< of a stop: fast or best; default: best
    std::optional<WorldBox> box = {};
    std::optional<Cells> cells = {};  ///< default: as for NestedGrid
    MeshAttributes attributes = {};
    SurfaceStages stages = {};
    std::optional<LabelSmoothing> smooth = {};  ///< can only be closed with close = below
};

/// The part of a plane inside the volume. Triangles face against the plane's normal and have the
/// attribute "value".
struct SliceQuery {
    WorldPlane plane = {};
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    Cells cells = Cells::tetrahedra;
    MeshAttributes attributes = {};
};

/// The lines in a plane where the data equal one of `values` (at most 1000), with the attribute
/// "value".
struct ContourQuery {
    WorldPlane plane = {};
    std::vector<double> values = {};
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
};

/// The surface z = scale U, facing up. The store must have one node along z.
struct GraphQuery {
    double scale = 1;
    StopTest stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    /// hexahedra: quadrilaterals, written as triangles; the error bound is for the function that is
    /// bilinear in each.
    Cells cells = Cells::tetrahedra;
    MeshAttributes attributes = {};
};

/// A query for the surface of a label with the options of `like`. Throws Error{invalid_argument}
/// for options that surfaces of labels do not support.
LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label);

/// The fields that a store must have for the query, in the order of a store: default_indicators(),
/// and those of the stop test, the bound, the culling and the attributes.
std::vector<Field> fields_needed(const SurfaceQuery& query);
std::vector<Field> fields_needed(const SliceQuery& query);
std::vector<Field> fields_needed(const GraphQuery& query);

struct ExtractOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum bytes of heap, not counting the
                                                     ///< sink's
    int threads = 0;                                 ///< 0 = all cores
    /// Folder of the unnamed temporary files for data that does not fit into memory; empty = the
    /// system's temporary folder.
    std::filesystem::path scratch = {};
    bool quality = false;  ///< report the distribution of the triangles' angles
    /// Other processes that share the traversals; null: none. For internal use.
    detail::RankTeam* team = nullptr;
};

/// Passes the mesh to `sink`. Coordinates are float32, in world units. Values are float32 if that
/// represents the store's values exactly, otherwise float64 if the sink supports it. The mesh
/// depends only on the volume and the query, not on memory or threads. An empty result is a mesh
/// without elements, not an error.
///
/// Throws Error{invalid_argument} (the query is invalid, or not possible for this store),
/// Error{not_found} (the store lacks the field that the stop test needs), Error{limit} (memory, or
/// numbers beyond float32), Error{corrupt, io, cancelled}, and what the sink throws. Thread-safety:
/// any number of concurrent calls with different sinks, also on the same store.
ExtractReport extract(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const LabelQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const SliceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const ContourQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const GraphQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// Maximum number of isovalues per call of extract_isovalues().
inline constexpr std::size_t kMaxIsovalues = 256;
[[deprecated("now called kMaxIsovalues")]] inline constexpr std::size_t kMostIsovalues =
    kMaxIsovalues;

/// Extracts the surfaces (or isolines) of several isovalues; query.iso is ignored. Each gets its
/// own mesh, identical to the one that extract() makes for that isovalue alone. Isovalues that fit
/// into memory together are extracted together and each chunk is decoded once for all of them. With
/// a TriangleBudgetByError, a kept analysis or a rotated volume, they are extracted one after
/// another.
///
/// `sink` and `done` are called from one thread, in order. All sinks of isovalues that are
/// extracted together exist at the same time and must agree on holds_float64(). Their reports count
/// the reads and seconds of the whole group.
///
/// Throws as extract(), also if an isovalue occurs twice; Error{limit} for more than kMaxIsovalues.
/// Meshes that are already finished are kept.
void extract_isovalues(const Store& store, std::span<const double> isovalues,
                       const SurfaceQuery& query,
                       const std::function<std::unique_ptr<MeshSink>(std::size_t number)>& sink,
                       const std::function<void(std::size_t number, const ExtractReport&)>& done,
                       const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// Extracts the interfaces of labels (from find_labels()) as one mesh. Each vertex and each
/// triangle occurs once, with the labels on both sides (MeshLayout::has_sides).
///
/// The mesh contains the triangles that extract_labels() gives for these labels: the mesh of a
/// label consists of the triangles with that label behind them and, flipped, those with it in
/// front. Interfaces with all labels that touch one of `labels` are included; their triangles face
/// from the smaller label to the larger one. So are interfaces with unlabelled space
/// (InterfaceReport::outside) at missing nodes and, with SurfaceStages::close, at the volume's
/// border; their triangles face that space.
///
/// `query` must have `smooth`; its label is ignored. The report's area counts each interface once,
/// there is no volume, and the smooth bound holds for all labels. `each`, if not empty, is called
/// for every interface, from one thread, after the mesh's end(). Throws as extract_labels(),
/// Error{invalid_argument} without `smooth`, and what `each` throws.
ExtractReport extract_interfaces(const Store& store, std::span<const Label> labels,
                                 const LabelQuery& query, MeshSink& sink,
                                 const std::function<void(const LabelInterface&)>& each = {},
                                 const ExtractOptions& options = {},
                                 Progress& progress = silent_progress());

/// Extracts the surfaces of labels (from find_labels()). Each gets its own mesh, the one that
/// extract() makes with query.label set to it. Several labels are processed at a time and share the
/// memory and the threads. Smooth meshes come from one traversal for all labels; their reports
/// count its reads, and the seconds since its start.
///
/// `sink` and `done` are called from many threads, with a label and with its index in `labels`.
/// Throws as extract(), and for smooth meshes Error{unsupported} if the values are not labels.
/// Meshes that are already finished are kept.
void extract_labels(const Store& store, std::span<const Label> labels, const LabelQuery& query,
                    const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
