// From a store to a surface, a slice, contour lines or a graph with a guaranteed error.
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

/// Leaves out what faces away from a viewer who looks in `direction` (section 5 of the paper).
struct BackfaceCulling {
    Double3 direction{};
    /// normal_turn_plus or grad_linf_plus; whichever the store has.
    std::optional<Field> field = {};
};

// What to extract. `focus` and `camera` loosen the stop test with the distance, `box` cuts what is
// extracted at its faces. What goes not with what is one table (tools/MANUAL.md shows it);
// extract() refuses it.

/// Numbers that every vertex carries beside its place.
struct MeshAttributes {
    bool normals = false;  ///< of length 1, of the gradient; of graphs and slices their own
    /// "value", from another store with the same nodes, which has to live as long as the call.
    const Store* values = nullptr;
    std::optional<Field> error = {};  ///< "error": this field
};

/// Which elements of the nested grid are visited, and what is made in its leaves.
struct NestedGrid {
    /// Hexahedra give about a third of the triangles that tetrahedra give: those of marching cubes,
    /// where the corners of a face on alternate sides keep the values below the isovalue apart.
    /// Cells with a missing corner have no surface. An error, or the threshold of a field of cells,
    /// needs that field (hex_deviation, hex_linf for an estimate), and bounds how far the data are
    /// from the function whose surface is shown, which is trilinear in each cell. Nothing:
    /// hexahedra if a DistanceBound or a TriangleBudget simplifies the surface, and if there is
    /// nothing in the query that hexahedra do not go with; else tetrahedra.
    std::optional<Cells> cells = {};
    VertexPlace vertices = VertexPlace::linear;  ///< within a distance they are exact in any case
    /// By which elements without surface are left out; the tightest that the store has.
    std::optional<Field> bound = {};
    std::optional<BackfaceCulling> culling = {};
};

/// The surface {U = iso}, triangles that face smaller values; of a store with one flat axis the
/// lines {U = iso}.
struct SurfaceQuery {
    double iso = 0;
    SurfaceStop stop = {};
    std::optional<Focus> focus = {};
    std::optional<Camera> camera = {};
    std::optional<WorldBox> box = {};
    NestedGrid grid = {};
    MeshAttributes attributes = {};
    SurfaceStages stages = {};
    std::optional<KeptAnalysis> analysis = {};  ///< for a DistanceBound or TriangleBudget
    /// The report says between which volumes that of the closed solid lies at full resolution. Two
    /// more surfaces are extracted for it, and thrown away.
    bool volume_interval = false;
};

/// Nodes with a label; none outside of [low, high] (as find_labels() says) is looked at.
struct LabelChoice {
    std::int64_t id = 0;
    std::optional<std::pair<Int3, Int3>> within = {};
};

/// In place of surfaces half way between nodes: surface nets, which adjacent labels share, with
/// vertices moved again and again towards their neighbours' mean, but never out of their cells.
/// What is proven of them: every node of the volume lies inside the mesh of its label and of no
/// other; SmoothReport::bound; where two labels touch, both meshes have the same vertices and the
/// same triangles, seen from both sides. All labels of the store shape the meshes, also those that
/// are not asked for. A label that touches itself along an edge of its voxels has an edge of four
/// triangles there, else a mesh's edges have two. At the volume's border, half a node's distance
/// beyond the last nodes, the meshes are open, or closed with SurfaceStages::close. Components that
/// are dropped change nothing of the others: nodes of theirs lie inside no mesh, or, of a cavity,
/// inside the mesh around it as well.
struct LabelSmoothing {
    static constexpr int kMostPasses = 64;
    /// How often vertices are moved, 0 ... kMostPasses; 0: the faces of the voxels.
    int passes = 16;
    /// Where they are simplified within a distance: no node changes sides, whatever the distance;
    /// else none that is further from the surfaces than it.
    bool keep_nodes = false;
};

/// Of a volume: the surface around the nodes that have this label. It lies half way between them
/// and the others.
struct LabelQuery {
    LabelChoice label = {};
    std::optional<DistanceStop> stop = {};  ///< nothing: full resolution
    std::optional<WorldBox> box = {};
    std::optional<Cells> cells = {};  ///< nothing: as of a NestedGrid
    MeshAttributes attributes = {};
    SurfaceStages stages = {};
    std::optional<LabelSmoothing> smooth = {};  ///< goes with close = below alone
};

/// The part of a plane inside the volume, triangles that face against its normal and have the
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
    /// hexahedra: quadrilaterals, written as triangles; the bound is one for the function that is
    /// bilinear in each.
    Cells cells = Cells::tetrahedra;
    MeshAttributes attributes = {};
};

/// The surface of a label, made as `like` makes that of its isovalue. Throws
/// Error{invalid_argument} for what surfaces of labels do not have.
LabelQuery label_query(const SurfaceQuery& like, const LabelChoice& label);

struct ExtractOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most, beside the sink's
    int threads = 0;                                 ///< 0 = all cores
    /// Where what does not fit into the memory goes, in files without names; empty = the system's
    /// folder for temporary files.
    std::filesystem::path scratch = {};
    bool quality = false;  ///< the report says which angles the triangles have
    /// Other processes that share the traversals; null: none. For the library's own use.
    detail::RankTeam* team = nullptr;
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
ExtractReport extract(const Store& store, const LabelQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const SliceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const ContourQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());
ExtractReport extract(const Store& store, const GraphQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// How many isovalues extract_isovalues() takes at once.
inline constexpr std::size_t kMostIsovalues = 256;

/// The surfaces (or isolines) of several isovalues, in place of query.iso: a mesh each, the same as
/// extract() makes of it alone. Chunks are decoded once for all that the memory holds at a time;
/// with an ErrorBudget, a kept analysis or a volume that is turned they are made one after the
/// other. `sink` and `done` are called from one thread, in order; all sinks of those that are made
/// together live at the same time, and say the same of holds_float64(). The reports count what was
/// read and the seconds of all that are made together. Throws as extract(), and for the same
/// isovalue twice; Error{limit} for more than kMostIsovalues. The meshes that are finished stay.
void extract_isovalues(const Store& store, std::span<const double> isovalues,
                       const SurfaceQuery& query,
                       const std::function<std::unique_ptr<MeshSink>(std::size_t number)>& sink,
                       const std::function<void(std::size_t number, const ExtractReport&)>& done,
                       const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// The interfaces of labels (as of find_labels()) as one mesh, in which each vertex and each
/// triangle is once, with the labels on both sides of it (MeshLayout::has_sides). It is the
/// triangles that extract_labels() gives these labels, whose meshes are cut from it: those with a
/// label behind them, and, turned round, those with it in front. There are interfaces with all
/// labels that touch one of `labels`, which face from the smaller label to the larger one; and with
/// what has no label (InterfaceReport::outside), which the triangles face, at missing nodes and
/// with SurfaceStages::close at the volume's border. `query`: with `smooth`; its label is not used.
/// The report's area is that of each interface once, without a volume, and its smooth bound that of
/// all labels. `each`, if not empty, is called with every interface, from one thread, behind the
/// mesh's end(). Throws as extract_labels(), Error{invalid_argument} without `smooth`, and what
/// `each` throws.
ExtractReport extract_interfaces(const Store& store, std::span<const Label> labels,
                                 const LabelQuery& query, MeshSink& sink,
                                 const std::function<void(const LabelInterface&)>& each = {},
                                 const ExtractOptions& options = {},
                                 Progress& progress = silent_progress());

/// The surfaces of labels (as of find_labels()), a mesh each, that extract() makes with query.label
/// set to them; several at a time, which share the memory and the threads. Smooth ones come out of
/// one traversal for all labels, and their reports count what it read and the seconds from its
/// beginning. `sink` and `done` are called from many threads, with a label and with its number in
/// `labels`. Throws as extract(), and for smooth ones Error{unsupported} for values that are no
/// labels: the meshes that are finished stay.
void extract_labels(const Store& store, std::span<const Label> labels, const LabelQuery& query,
                    const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
