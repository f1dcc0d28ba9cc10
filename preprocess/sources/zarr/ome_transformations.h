// How OME's coordinate transformations place the positions of an array.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace isonest::detail {

/// An affine map: world coordinate i = sum over axes j of at(i, j) position[j] + at(i, axes).
class AxisMap {
  public:
    AxisMap() = default;
    /// The identity.
    explicit AxisMap(std::size_t axes);

    [[nodiscard]] std::size_t axes() const { return axes_; }
    [[nodiscard]] double& at(std::size_t row, std::size_t column) {
        return numbers_[row * (axes_ + 1) + column];
    }
    [[nodiscard]] double at(std::size_t row, std::size_t column) const {
        return numbers_[row * (axes_ + 1) + column];
    }
    /// The map that applies this one, and then `next`. REQUIRES: the same number of axes.
    [[nodiscard]] AxisMap then(const AxisMap& next) const;

  private:
    std::size_t axes_ = 0;
    std::vector<double> numbers_;
};

/// What OME's description of an axis says; empty where it says nothing.
struct OmeAxis {
    std::string name;
    std::string type;
    std::string unit;
};

/// Where OME places an array.
struct OmeCoordinates {
    std::vector<OmeAxis> array;  ///< its axes; empty if they are not described
    std::vector<OmeAxis> world;  ///< of the coordinates; empty: the array's
    AxisMap map;
    bool says_scale = false;  ///< whether there is a scale or an affine transformation
    std::vector<std::string> notes = {};
};

/// For an array with so many axes. `image`: a member of OME's "multiscales"; `dataset`: one of its
/// "datasets". Up to version 0.5 the image's transformations follow those of the dataset, all in
/// their order. Since 0.6 (RFC-5) those of the image are alternatives, each from the dataset's
/// coordinate system to another: the first one is taken, and a note names the others.
///
/// Supported: identity, scale, translation, rotation, affine (with as many rows as axes), and
/// sequences of them, with numbers for each axis in the description. Throws Error{unsupported} for
/// others. `name`: of the array, for messages.
///
/// Source: https://ngff.openmicroscopy.org/rfc/5, and versions 0.4 and 0.5.
OmeCoordinates ome_coordinates(const nlohmann::json& image, const nlohmann::json& dataset,
                               std::size_t axes, const std::string& name);

}  // namespace isonest::detail
