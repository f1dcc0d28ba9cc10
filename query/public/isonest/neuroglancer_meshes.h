// Meshes of smooth labels in several levels of detail, as Neuroglancer reads them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include <isonest/extract.h>
#include <isonest/extract_report.h>
#include <isonest/labels.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest {

/// A label's mesh at a level of detail, as it is written: cut into cells, and packed.
struct DetailLevel {
    /// Proven, world units: the label's whole net and this level are within it of each other. What
    /// coordinates are rounded counts in.
    double bound = 0;
    std::uint64_t triangles = 0;  ///< with those that cuts add
    std::uint64_t fragments = 0;  ///< cells that have triangles
    std::uint64_t bytes = 0;      ///< of all of them
};

struct NeuroglancerReport {
    /// Of the finest level, before it is cut; its bounds count in that it is rounded once more.
    ExtractReport finest;
    std::vector<DetailLevel> levels;  ///< from the finest one on
};

/// The volume over which Neuroglancer shows meshes. OME-Zarr says where the middle of the first
/// voxel is, as stores do. A precomputed volume counts from the voxel's low corner: meshes over it
/// have to be moved by half a voxel along each axis.
enum class VoxelOrigin { middle, corner };

/// By how much meshes are moved for such a volume, world units.
Double3 shift_of(const Store& store, VoxelOrigin origin);

/// Whether this build can write them, which needs Draco.
bool has_neuroglancer_meshes();

/// Writes the meshes of labels (as of find_labels()) into a folder that is there, in the format
/// neuroglancer_multilod_draco, not sharded: the files `info`, LABEL.index and LABEL of each, and,
/// where the store has names of labels, the folder segment_properties. `query`: with `smooth` and
/// without components; its label is not used. Level 0 is what extract_labels() makes of the query,
/// at full resolution or within its stop's distance D, which then counts in that positions are
/// rounded; level k is within 2^k D, or 2^k quarters of a voxel where that is more. A label has
/// levels as long as each has at most 3/4 of the triangles of the one before, and that one more
/// than a few hundred. Positions are rounded to 1/65535 of a cell, which is 64 nodes wide at level
/// 0, or less where so many triangles are in one, and twice as wide at each level behind. Names of
/// files are as in Neuroglancer, so labels below 0 are refused. Existing files are replaced. `done`
/// is called from many threads, with a label's number in `labels`. The bytes depend on the store,
/// the query and the version of Draco alone. What finished labels have written stays if a later one
/// fails; `info` comes last. `origin`: of the volume that they are shown with. Throws as
/// extract_labels() of smooth labels, Error{unsupported} without Draco, Error{invalid_argument} for
/// a label below 0, and Error{io}.
void extract_neuroglancer_meshes(
    const Store& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options = {}, Progress& progress = silent_progress(),
    VoxelOrigin origin = VoxelOrigin::middle);

}  // namespace isonest
