// Several meshes in one file, each an object with its own name and colour.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/mesh_file.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

namespace isonest {

/// An object of the file.
struct MeshObject {
    std::string title = {};                ///< as MeshFileOptions::title
    std::optional<LabelColor> color = {};  ///< as MeshFileOptions::color
};

/// Writes .glb (a node, a mesh and a material per object), .3mf (an object and an item per object)
/// and .vtkhdf (a partitioned dataset per object in a collection, VTKHDF 2.1: the name of its block
/// has the title's letters and digits, title and colour are attributes). Meshes are kept in a
/// temporary file until all are complete, because such files begin with a description of all of
/// them. Objects without triangles are left out.
class MeshCollection {
  public:
    /// Whether the format of this name can hold several objects.
    static bool is_supported(const std::filesystem::path& path);

    /// `options`: title and colour are ignored. `scratch`: folder for temporary files; empty: the
    /// system's. Throws as open_mesh_file(), and Error{invalid_argument} if the format holds one
    /// mesh only.
    MeshCollection(const std::filesystem::path& path, std::vector<MeshObject> objects,
                   const MeshFileOptions& options = {}, const std::filesystem::path& scratch = {});
    MeshCollection(const MeshCollection&) = delete;
    MeshCollection& operator=(const MeshCollection&) = delete;
    ~MeshCollection();

    /// The destination of an object's mesh, once per object. All meshes must have the same
    /// attributes, unit and frame. The sinks may be used at the same time; the collection must
    /// outlive them. They throw as the sink of open_mesh_file().
    [[nodiscard]] std::unique_ptr<MeshSink> sink(std::size_t object);

    /// Writes the file. The objects are in the given order, even if their meshes came in another
    /// one. Throws Error{limit} for more than the format can number, Error{io, cancelled}.
    void finish(Progress& progress = silent_progress());

    struct Parts;

  private:
    std::unique_ptr<Parts> parts_;
};

}  // namespace isonest
