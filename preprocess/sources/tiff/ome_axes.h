// What OME's description in a TIFF says of its pages.
#pragma once

#include <optional>
#include <string>

#include "preprocess/sources/tiff/tiff_axes.h"

namespace isonest::detail {

/// None for a description that is none of OME's, or has no image. Throws as axes_of_description().
/// Source: https://docs.openmicroscopy.org/ome-model/6.3.1/ome-tiff/specification.html
std::optional<TiffAxes> axes_of_ome(const std::string& description, const TiffSet& set);

}  // namespace isonest::detail
