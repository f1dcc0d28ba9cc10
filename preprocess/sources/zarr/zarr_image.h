// Which array of a Zarr folder is the volume, and its place: OME images, or a single array.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/zarr/ome_transformations.h"
#include "preprocess/sources/zarr/zarr_array.h"

namespace isonest::detail {

// What OME says about the labels of an image.

/// `image_label`: OME's "image-label", or null. The name is the property "name" or, if there is
/// none, "class"; the colour is from `colors`. Source:
/// https://ngff.openmicroscopy.org/0.5/#label-md
FoundLabels labels_of_ome(const nlohmann::json& image_label);

struct ZarrImage {
    ZarrArray array;
    std::vector<ArrayAxis> axes;     ///< of the array
    AxisMap map;                     ///< from positions to coordinates
    std::vector<std::string> units;  ///< per coordinate; empty if not given
    std::vector<std::string> world;  ///< names of the coordinates, unless they are those of `axes`
    bool ome = false;                ///< OME's description determines the place
    bool says_scale = false;         ///< and it gives a scale
    FoundLabels labels = {};         ///< what OME says about its labels
    std::vector<std::string> notes = {};
    std::vector<std::filesystem::path> files;  ///< the descriptions that were read
};

/// `root`: an array, an OME image (its finest level, unless `dataset` is the path of another one),
/// or a group: of its arrays and images the only one with the most axes longer than 1. Source:
/// https://ngff.openmicroscopy.org (0.4, 0.5, and of 0.6 the coordinate systems of RFC-5).
/// Throws Error{not_found, invalid_argument}, listing what there is, and what read_zarr_array()
/// throws. If folders cannot be listed, the members of a group are those that its OME metadata
/// name; for a group without OME metadata, Error{invalid_argument} asks which member is meant.
ZarrImage find_zarr_image(ZarrFiles& files, const std::filesystem::path& root,
                          const std::string& dataset);

}  // namespace isonest::detail
