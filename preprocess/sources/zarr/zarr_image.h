// Which array of a Zarr folder is the volume, and where it lies: OME's images, or a lone array.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/label_names/found_labels.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/zarr/zarr_array.h"

namespace isonest::detail {

struct ZarrImage {
    ZarrArray array;
    std::vector<ArrayAxis> axes;      ///< of the array
    std::vector<double> scale;        ///< per axis: world units from one position to the next
    std::vector<double> translation;  ///< per axis: where position 0 lies
    std::vector<std::string> units;   ///< per axis: what the two are in; empty if nothing says
    bool ome = false;                 ///< OME's description places it
    bool says_scale = false;          ///< and says a scale
    FoundLabels labels = {};          ///< what OME says of its labels
    std::vector<std::filesystem::path> files;  ///< the descriptions that were read
};

/// `root`: an array, an OME image (then its finest level, unless `dataset` names another one's
/// path), or a group: of its arrays and images the only one with the most axes of more than one
/// position. Source: https://ngff.openmicroscopy.org (0.4, 0.5).
/// Throws Error{not_found, invalid_argument} (listing what there is), and what read_zarr_array()
/// throws. Where folders cannot be listed, the members of a group are those that OME's words on it
/// name; of another group, Error{invalid_argument} asks which one is meant.
ZarrImage find_zarr_image(ZarrFiles& files, const std::filesystem::path& root,
                          const std::string& dataset);

}  // namespace isonest::detail
