// Surfaces as OGC 3D Tiles: an octree of meshes, each with its proven distance from the full
// surface, for viewers that load only what they show.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/mesh_file.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

namespace isonest {

/// A place on the WGS 84 ellipsoid.
struct Georeference {
    double longitude = 0;  ///< degrees east, -180 to 180
    double latitude = 0;   ///< degrees north, -90 to 90
    double height = 0;     ///< metres above the ellipsoid
};

/// One of several surfaces in a tileset: a label's, or an isovalue's.
struct TileFeature {
    std::optional<std::int64_t> label = {};
    std::optional<double> isovalue = {};
    std::string name = {};  ///< UTF-8 without control characters; empty: none
    std::optional<LabelColor> color = {};
};

struct TilesetOptions {
    /// Whether to replace an existing folder. Only a folder that contains a tileset is replaced.
    bool replace = false;
    /// The lattice of the volume: its own axes in the world (unit vectors at right angles), the
    /// place of node (0, 0, 0), and the distances of nodes along the axes. Tiles end in planes of
    /// nodes, about 64 nodes apart at the finest level. Of a sheared lattice: own axes as of a
    /// mesh.
    Double3 origin{};
    Directions axes = kAlongWorld;
    Double3 spacing{1, 1, 1};
    /// A box that contains all meshes, in nodes along the own axes. The same box gives the same
    /// tiles for all surfaces of a volume.
    Double3 first{};
    Double3 last{};
    /// With more than one, each vertex has the number of its feature, and each tile a table of its
    /// features. For isovalues: in the order of the attribute "isovalue", each once.
    std::vector<TileFeature> features = {};
    std::string title = {};
    std::optional<LabelColor> color = {};
    MeshSpace space = MeshSpace::automatic;
    /// Colours of vertices by the attribute "value" or "error".
    std::optional<VertexColors> colors = {};
    /// The place of the world's origin; x then points east, y north, z up.
    std::optional<Georeference> georeference = {};
    /// Bytes of heap, and threads (0: one per core), for finish().
    std::uint64_t memory = std::uint64_t{512} << 20U;
    int threads = 0;
    /// Folder for temporary files; empty: the system's.
    std::filesystem::path scratch = {};
};

/// What is known about the meshes of a tileset.
struct TilesetSource {
    /// Proven distance of the meshes from the full surface, world units, >= 0.
    double bound = 0;
    /// The surface from which the errors of tiles are measured, for "asset.extras".
    std::string surface = "the surface at full resolution";
};

/// The tiles of one level of the octree.
struct TileLevel {
    double bound = 0;             ///< largest error of a tile, world units
    std::uint64_t tiles = 0;      ///< with a mesh
    std::uint64_t triangles = 0;  ///< in them
    std::uint64_t bytes = 0;      ///< of their files
    /// Cubes whose mesh cannot be simplified to the size of a tile: clients always load their
    /// parts.
    std::uint64_t without_mesh = 0;
};

struct TilesetReport {
    std::vector<TileLevel> levels;  ///< finest first
    std::uint64_t files = 0;
    std::uint64_t bytes = 0;  ///< of all files
    std::uint64_t scratch_bytes = 0;
};

/// Writes a folder with OGC 3D Tiles 1.1: tileset.json, further tilesets for deep octrees, and a
/// glTF file for each tile. The meshes come from any extraction:
///
///     Tileset tileset("site", options);
///     extract(store, query, *tileset.sink(), extract_options);
///     tileset.finish();
///
/// Tiles at the finest level are the mesh, cut at cubes. A tile at the next level is made from the
/// up to eight below it: joined, and simplified to a multiple of its error, with its border kept.
/// So neighbouring tiles have the same border, whatever their levels: there are no gaps between
/// them. A level's error is at most twice that of the level below, beginning with half a node
/// distance or twice the mesh's own. The error of each tile is proven: no point of it is further
/// from the full surface, and no point of the surface in its cube is further from it. It includes
/// the rounding of coordinates to 1/32768 of a tile's edge.
///
/// Triangles that rounding would collapse to lines are kept one step wide where nothing else is
/// left of the surface. Lengths are in metres if the unit is known, otherwise one world unit counts
/// as one metre. The output depends on the meshes and the options, not on memory or threads, and on
/// the version of meshoptimizer, if the build has it.
///
/// The folder appears under its name only when finish() ends, complete. The destructor removes what
/// is unfinished. Thread-safety: sinks may be used from several threads, each from one at a time;
/// the rest from one thread.
class Tileset {
  public:
    /// Throws Error{invalid_argument} for options outside their ranges, or if the folder must not
    /// be replaced; Error{not_found} if its parent folder does not exist; Error{limit} if there is
    /// too little memory; Error{io}.
    Tileset(const std::filesystem::path& folder, const TilesetOptions& options);
    Tileset(const Tileset&) = delete;
    Tileset& operator=(const Tileset&) = delete;
    ~Tileset();

    /// A destination for one mesh of triangles, to be used within the tileset's lifetime. Normals
    /// and the attribute "value" or, without it, "error" are kept. Without normals, those of the
    /// triangles around a vertex are used. `feature`: the mesh's place in the features, below
    /// their number; ignored if the mesh has the attribute "isovalue". The sink throws
    /// Error{invalid_argument} for lines and for a mesh beyond the tileset's box, and Error{io}.
    [[nodiscard]] std::unique_ptr<MeshSink> sink(std::size_t feature = 0);

    /// Writes everything. Call once, after the last sink has received its mesh. Throws
    /// Error{limit} if there are too many triangles in a small space, and
    /// Error{invalid_argument, io, cancelled}.
    TilesetReport finish(const TilesetSource& source = {}, Progress& progress = silent_progress());

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace isonest
