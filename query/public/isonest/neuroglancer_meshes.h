// Meshes of smooth labels at several levels of detail, in Neuroglancer's format.
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

/// A label's mesh at one level of detail, as written: cut into cells and compressed.
struct DetailLevel {
    /// Proven maximum distance, in both directions, between the label's whole net and this level,
    /// in world units. Includes the rounding of coordinates.
    double bound = 0;
    std::uint64_t triangles = 0;  ///< including those added by cutting
    std::uint64_t fragments = 0;  ///< cells with triangles
    std::uint64_t bytes = 0;      ///< of all fragments
};

struct NeuroglancerReport {
    /// The finest level before cutting. Its bounds include the additional rounding of the format.
    ExtractReport finest;
    std::vector<DetailLevel> levels;  ///< finest first
};

/// The kind of volume shown together with the meshes. OME-Zarr gives the position of the centre of
/// the first voxel, as stores do. Precomputed volumes count from the voxel's low corner: their
/// meshes must be shifted by half a voxel along each axis.
enum class VoxelOrigin { middle, corner };

/// How meshes are stored: two files for each label, or shards (neuroglancer_uint64_sharded_v1),
/// files with about 64 to 128 labels each.
enum class MeshStorage { files, shards };

/// Shift of the meshes for such a volume, in world units.
Double3 shift_of(const Store& store, VoxelOrigin origin);

/// Whether this build can write these meshes; needs Draco.
bool has_neuroglancer_meshes();

/// Writes the meshes of labels (from find_labels()) into an existing folder, in the format
/// neuroglancer_multilod_draco: the file `info`, files LABEL.index and LABEL for each label, or
/// shards, and, if the store has label names, the folder segment_properties; if it has colours,
/// segment_colors.json, the member "segmentColors" of a segmentation layer. Existing files are
/// replaced. The output depends only on the store, the query and the version of Draco.
///
/// `query` must have `smooth` and no components; its label is ignored. Level 0 is the result of
/// extract_labels() for the query, at full resolution or within its distance D; D then includes the
/// rounding of positions. Level k is within 2^k D, or within 2^k quarters of a voxel if that is
/// more. A level is added as long as it has at most 3/4 of the triangles of the one before, and
/// that one has more than a few hundred. Positions are rounded to 1/65535 of a cell. A cell is 64
/// nodes wide at level 0 (less if it would contain too many triangles) and twice as wide at each
/// further level.
///
/// File names follow Neuroglancer's convention, so negative labels are rejected. `done` is called
/// from many threads, with the index of a label in `labels`. `info` is written last; if a label
/// fails, the files of finished labels are kept, and shards are not written. `origin`: kind of the
/// volume shown with the meshes.
///
/// Throws as extract_labels() for smooth labels, Error{unsupported} without Draco,
/// Error{invalid_argument} for a negative label, and Error{io}.
void extract_neuroglancer_meshes(
    const Store& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options = {}, Progress& progress = silent_progress(),
    VoxelOrigin origin = VoxelOrigin::middle, MeshStorage storage = MeshStorage::files);

}  // namespace isonest
