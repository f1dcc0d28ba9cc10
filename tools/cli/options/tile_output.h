// Where extract writes surfaces: a mesh file, a file of several objects, or a folder of 3D Tiles.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/mesh_collection.h>
#include <isonest/mesh_file.h>
#include <isonest/tileset.h>

#include "store/container/format.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

/// The format's name in --format.
inline constexpr const char* kTiles = "3dtiles";

/// Adds --georeference.
void add_tile_options(CLI::App* command, ExtractArguments& a);

/// Whether the surface is written as tiles.
inline bool makes_tiles(const ExtractArguments& a) {
    return a.tiles;
}

/// Whether several labels or isovalues become objects of one file of this name. `format`: the value
/// of --format, or empty.
bool makes_objects(const std::string& mesh, const std::string& format);

/// The name of a folder without slashes at its end, so that its parent folder is known.
std::string folder_name(std::string name);

/// Sets the lattice of a volume, in a box that is half a voxel larger than the nodes, as smooth
/// labels are. `heights`: of a graph, the smallest and the largest.
void set_lattice(const StoreHeader& header, const std::optional<std::array<double, 2>>& heights,
                 TilesetOptions& options);

/// One output of an extraction.
class MeshOutput {
  public:
    /// `file`: for a mesh file; the title and the colours also for tiles. `header`: the volume's.
    /// `features`: the surfaces of a tileset or of a file of several objects. `heights`: of a
    /// graph, the smallest and the largest. Throws as open_mesh_file(), MeshCollection and Tileset.
    MeshOutput(const ExtractArguments& a, const MeshFileOptions& file, const StoreHeader& header,
               std::vector<TileFeature> features = {},
               std::optional<std::array<double, 2>> heights = {});

    /// The destination of the only mesh, or of that of a feature. Thread-safe for features.
    std::unique_ptr<MeshSink> sink(std::size_t feature = 0);
    /// After the extraction: writes the tiles or the objects, and adds what was written to the
    /// result. `r`: the report on the mesh; if there are several, one with the largest distance.
    void finish(const ExtractReport& r, Progress& progress, Result& result);

  private:
    std::string mesh_;
    MeshFileOptions file_;
    VertexFields* fields_;  ///< null: none
    std::string unit_;
    std::unique_ptr<Tileset> tileset_;            ///< null if a file is written
    std::unique_ptr<MeshCollection> collection_;  ///< null unless a file of several objects
};

}  // namespace isonest::detail::cli
