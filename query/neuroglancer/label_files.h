// The files of a label's mesh in Neuroglancer's format of several levels of detail.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/neuroglancer_meshes.h>

#include "query/neuroglancer/cut_mesh.h"
#include "query/neuroglancer/shards.h"
#include "query/simplify/block_files.h"
#include "store/container/format.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The octree of Neuroglancer's fragments of a mesh.

/// A cell of a level of detail.
struct DetailNode {
    Int3 cell{};
    std::uint32_t bytes = 0;    ///< size of its fragment; 0: none
    std::uint32_t eighths = 0;  ///< eighths that have triangles, a bit each (eighths_of())
};

/// The nodes that Neuroglancer must find in a manifest. Besides those with a fragment these are,
/// without one: each node above another node, so that the tree is connected; and below a node with
/// a fragment, the nodes where it has triangles, so that what is drawn instead of a part of it is
/// everything that the finer level has there, which may be nothing. Stored in temporary files. Not
/// thread-safe.
class DetailNodes {
  public:
    explicit DetailNodes(ScratchFolder folder) : folder_(std::move(folder)) {}

    /// Starts the next level; its nodes are added by add(), in the order of the Z-curve.
    void begin_level() { levels_.push_back(std::make_unique<GrowingFile<DetailNode>>(folder_)); }
    /// Adds a node with a fragment.
    void add(const DetailNode& node) { levels_.back()->append(node); }
    /// Call once after all were added: adds those without a fragment.
    void finish();

    [[nodiscard]] std::size_t levels() const { return levels_.size(); }
    /// The nodes in the order of the Z-curve. REQUIRES: finish() was called.
    [[nodiscard]] std::span<const DetailNode> of(std::size_t level) const {
        return levels_[level]->all();
    }

  private:
    using List = std::unique_ptr<GrowingFile<DetailNode>>;
    List merged(std::span<const DetailNode> a, std::span<const DetailNode> b) const;
    List children_of(std::span<const DetailNode> nodes) const;
    List parents_of(std::span<const DetailNode> nodes) const;

    ScratchFolder folder_;
    std::vector<List> levels_;
};

/// The fragments of all levels of a label, and their positions, the manifest. Not thread-safe.
class LabelFiles {
  public:
    /// `shards`: where both are added; null: they are the files LABEL and LABEL.index of the
    /// folder, which appear at the end and replace existing files; without publish() none appears.
    /// Throws Error{io, invalid_argument}.
    LabelFiles(const std::filesystem::path& folder, std::int64_t label,
               const ScratchFolder& scratch, Shards* shards = nullptr);

    /// Adds the next level. REQUIRES: no cell has more than kMaxInFragment triangles. Throws
    /// Error{io, cancelled}.
    DetailLevel add_level(const CutMesh& mesh, const Progress& progress);
    /// `scales`: for each level, in nodes, its maximum distance from the finest mesh. `grid`: of
    /// level 0. Throws Error{io, limit}.
    void publish(const DetailGrid& grid, std::span<const double> scales);

  private:
    /// Passes the manifest to add(bytes), piece by piece.
    template <class Add>
    void write_manifest(const DetailGrid& grid, std::span<const double> scales, const Add& add);

    std::int64_t label_;
    std::filesystem::path index_path_;
    std::optional<OutputFile> data_;  ///< without shards
    PiecedFile waiting_;              ///< the fragments, for the shards
    Shards* shards_;
    std::uint64_t end_ = 0;
    DetailNodes nodes_;
};

/// Writes the file `info`: the mapping from the lattice to the world, in nanometres if the unit is
/// known. Everything is moved by `shift`, world units. `properties`: whether there is a folder of
/// them. `sharding`: of meshes in shards. Throws Error{io}.
void write_mesh_info(const std::filesystem::path& folder, const StoreHeader& header,
                     const Double3& shift, bool properties,
                     const std::optional<Sharding>& sharding = {});

/// Writes the colours of labels, as those of a segmentation layer in Neuroglancer's state
/// ("segmentColors"), to the file `segment_colors.json`; nothing if none has a colour. Throws
/// Error{io}.
void write_segment_colors(const std::filesystem::path& folder, std::span<const LabelName> names);
/// Writes names of labels, displayed by Neuroglancer, to a folder `segment_properties`; labels
/// without a name get an empty one. Throws Error{io}.
void write_segment_properties(const std::filesystem::path& folder,
                              std::span<const LabelName> names);

}  // namespace isonest::detail
