// What the description in a TIFF's first page says of all pages.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/axis_units.h"

namespace isonest::detail {

struct TiffAxes {
    /// Of the pages, slowest first; their lengths' product is the number of pages.
    std::vector<ArrayAxis> pages;
    /// World units; none where nothing says so. x and y are 0 where the resolution tags say it.
    std::optional<Double3> spacing;
    CommonUnit unit = {};  ///< of the spacing as the file has it, along x, y and z
};

/// `pages`: how many there are (of ImageJ's files with one page and many images: the images).
/// ImageJ's and OME's descriptions name time, channels and slices; other pages are slices.
/// Throws Error{unsupported} for OME images of which these pages are only a part. No I/O.
TiffAxes axes_of_description(const std::string& description, std::int64_t pages,
                             const std::string& name);

/// ImageJ writes images of more than 4 GiB under one page: how many it says there are, else 1.
std::int64_t imagej_images(const std::string& description);

}  // namespace isonest::detail
