// What the description in the first page of a TIFF file says about all pages.
#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "preprocess/sources/placement/axis_choice.h"

namespace isonest::detail {

// Numbers in the texts of TIFF descriptions.

/// The number at the start of a text; `otherwise` if there is none.
template <class T>
T leading_number(std::string_view text, T otherwise) {
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end != text.data() ? value : otherwise;
}

// The elements of an OME-XML text that describe pages.

/// A start tag.
struct XmlElement {
    std::string name;                               ///< without its namespace prefix
    int depth = 0;                                  ///< 0 for the outermost element
    std::map<std::string, std::string> attributes;  ///< character references are resolved
    std::string text;                               ///< raw text from its start tag to the next tag
    /// Empty if there is no such attribute.
    [[nodiscard]] std::string attribute(const std::string& key) const;
};

/// All elements in document order; comments, instructions and CDATA sections are left out. `name`
/// is used in messages. Throws Error{corrupt} for a tag without an end. No I/O.
/// Source: https://www.w3.org/TR/xml/
std::vector<XmlElement> xml_elements(std::string_view text, const std::string& name);

struct TiffAxes {
    /// Axes of the pages, slowest first; the product of their lengths is the number of pages.
    std::vector<ArrayAxis> pages;
    /// In world units; none if not given. x and y are 0 if the resolution tags give them.
    std::optional<Double3> spacing;
    /// If there is a spacing: whether it is given along x, y and z.
    std::array<bool, 3> said{true, true, true};
    CommonUnit unit = {};  ///< of the spacing in the file, along x, y and z
    /// The page at each position of `pages`, slowest first; empty if pages are in order.
    std::vector<std::int64_t> order = {};
};

/// The pages that a description refers to.
struct TiffSet {
    /// Number of pages (for files with one page and many images: of images).
    std::int64_t pages = 1;
    std::int64_t width = 1;
    std::int64_t height = 1;
    std::int64_t samples = 1;        ///< per pixel
    std::string name;                ///< for messages
    std::vector<std::string> files;  ///< names without folders; the first file has the description
    /// Page number of (file, directory in the file), both by number; none if there is no such page.
    std::function<std::optional<std::int64_t>(std::size_t, std::int64_t)> page_of;
};

/// ImageJ's and OME's descriptions name time, channels and slices; in other files, pages are
/// slices. Throws Error{unsupported} for OME images of which these pages are only a part,
/// Error{corrupt} for invalid OME descriptions. No I/O.
TiffAxes axes_of_description(const std::string& description, const TiffSet& set);

/// How many images are stored under the first page, one after the other: ImageJ does so above 4
/// GiB, and tifffile if its user requests truncation. 1 if the description does not say so.
/// `values`: of an image; 0 if there are too many.
std::int64_t images_of_description(const std::string& description, std::int64_t values);

// What OME's description in a TIFF says about its pages.

/// None for a description that is not OME's, or has no image. Throws like axes_of_description().
/// Source: https://docs.openmicroscopy.org/ome-model/6.3.1/ome-tiff/specification.html
std::optional<TiffAxes> axes_of_ome(const std::string& description, const TiffSet& set);

}  // namespace isonest::detail
