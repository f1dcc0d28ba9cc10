// What OME says of the labels of an image.
#pragma once

#include <nlohmann/json.hpp>

#include "preprocess/sources/label_names/found_labels.h"

namespace isonest::detail {

/// `image_label`: OME's "image-label", or null. A name is a property "name", else "class"; a colour
/// is one of `colors`. Source: https://ngff.openmicroscopy.org/0.5/#label-md
FoundLabels labels_of_ome(const nlohmann::json& image_label);

}  // namespace isonest::detail
