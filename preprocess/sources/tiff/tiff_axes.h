// What the description in a TIFF's first page says of all pages.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
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
    /// Where there is a spacing: along which of x, y and z it is said.
    std::array<bool, 3> said{true, true, true};
    CommonUnit unit = {};  ///< of the spacing as the file has it, along x, y and z
    /// The page of each position of `pages`, slowest first; empty where that is its number.
    std::vector<std::int64_t> order = {};
};

/// What a description is about.
struct TiffSet {
    /// How many there are (of files with one page and many images: the images).
    std::int64_t pages = 1;
    std::int64_t width = 1;
    std::int64_t height = 1;
    std::int64_t samples = 1;        ///< of a pixel
    std::string name;                ///< for messages
    std::vector<std::string> files;  ///< names without folders; the first has the description
    /// The page that is a directory of a file, by their numbers; none if it is not there.
    std::function<std::optional<std::int64_t>(std::size_t, std::int64_t)> page_of;
};

/// ImageJ's and OME's descriptions name time, channels and slices; other pages are slices.
/// Throws Error{unsupported} for OME images of which these pages are only a part, Error{corrupt}
/// for words of OME that make no sense. No I/O.
TiffAxes axes_of_description(const std::string& description, const TiffSet& set);

/// How many images lie under the first page, one behind the other: ImageJ writes those of more than
/// 4 GiB so, tifffile what its user wants truncated. 1 where the description does not say so.
/// `values`: of an image; 0 if that is too many.
std::int64_t images_of_description(const std::string& description, std::int64_t values);

}  // namespace isonest::detail
