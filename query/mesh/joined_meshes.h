// The meshes of several isovalues as one mesh.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Keeps a mesh for each isovalue in temporary files until all are there: the joined one begins
/// with its counts.
class JoinedMeshes {
  public:
    /// REQUIRES: `sink` lives as long as this.
    JoinedMeshes(MeshSink& sink, std::span<const double> isovalues, ScratchFolder scratch);

    /// Where the mesh of isovalue number `i` goes. Its prepare() is that of the joined one. It must
    /// not outlive this.
    [[nodiscard]] std::unique_ptr<MeshSink> part(std::size_t i);
    /// One after the other, with the attribute "isovalue" behind those that they have. REQUIRES:
    /// all are whole. Throws Error{cancelled} and what the sink throws.
    void emit(Progress& progress);

  private:
    class Part;
    /// `layout` with the attribute.
    [[nodiscard]] MeshLayout with_isovalue(MeshLayout layout) const;

    MeshSink& sink_;
    std::vector<double> isovalues_;
    ScratchFolder scratch_;
    bool is_double_ = false;  ///< of the attribute
    std::vector<std::unique_ptr<ScratchMesh>> meshes_;
};

}  // namespace isonest::detail
