// The files of a label's mesh in Neuroglancer's format of several levels of detail.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/neuroglancer_meshes.h>

#include "query/neuroglancer/cut_mesh.h"
#include "query/neuroglancer/detail_nodes.h"
#include "store/container/format.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// LABEL, the fragments of all levels, and LABEL.index, which says where they are. Both appear at
/// the end, an existing one replaced; without publish() there is none. Not thread-safe.
class LabelFiles {
  public:
    /// Throws Error{io, invalid_argument}.
    LabelFiles(const std::filesystem::path& folder, std::int64_t label,
               const ScratchFolder& scratch);

    /// The level behind the last one. REQUIRES: no cell has more than kMostInFragment triangles.
    /// Throws Error{io, cancelled}.
    DetailLevel add_level(const CutMesh& mesh, const Progress& progress);
    /// `scales`: of each level, in nodes: how far it may be from the finest mesh. `grid`: of level
    /// 0. Throws Error{io, limit}.
    void publish(const DetailGrid& grid, std::span<const double> scales);

  private:
    std::filesystem::path index_path_;
    OutputFile data_;
    std::uint64_t end_ = 0;
    DetailNodes nodes_;
};

/// The file `info`: how places of the lattice lie in the world, in nanometres if its unit is known.
/// All is moved by `shift`, world units. `properties`: whether there is a folder of them. Throws
/// Error{io}.
void write_mesh_info(const std::filesystem::path& folder, const StoreHeader& header,
                     const Double3& shift, bool properties);

/// Names of labels, which Neuroglancer shows, in a folder `segment_properties`; labels without a
/// name have an empty one. Throws Error{io}.
void write_segment_properties(const std::filesystem::path& folder,
                              std::span<const LabelName> names);

}  // namespace isonest::detail
