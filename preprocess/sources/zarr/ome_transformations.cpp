#include "preprocess/sources/zarr/ome_transformations.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/zarr/zarr_files.h"

namespace isonest::detail {

AxisMap::AxisMap(std::size_t axes) : axes_(axes), numbers_(axes * (axes + 1)) {
    for (std::size_t i = 0; i < axes; ++i) {
        at(i, i) = 1;
    }
}

AxisMap AxisMap::then(const AxisMap& next) const {
    AxisMap all(axes_);
    for (std::size_t row = 0; row < axes_; ++row) {
        for (std::size_t column = 0; column <= axes_; ++column) {
            double sum = column == axes_ ? next.at(row, axes_) : 0;
            for (std::size_t i = 0; i < axes_; ++i) {
                sum += next.at(row, i) * at(i, column);
            }
            all.at(row, column) = sum;
        }
    }
    return all;
}

namespace {

using nlohmann::json;

std::string text_of(const json& text) {
    return text.is_string() ? text.get<std::string>() : std::string();
}

/// Sequences may be nested.
constexpr int kDeepest = 8;

class Transformations {
  public:
    Transformations(OmeCoordinates& coordinates, std::size_t axes, const std::string& name)
        : coordinates_(coordinates), axes_(axes), name_(name) {}

    void apply_all(const json& list, int depth = 0) {
        for (const json& one : list) {
            apply(one, depth);
        }
    }

    void apply(const json& one, int depth = 0) {
        const std::string type = text_of(member(one, "type"));
        AxisMap map(axes_);
        if (type == "scale") {
            const std::vector<double> numbers = numbers_in(one, member(one, "scale"), axes_);
            for (std::size_t i = 0; i < axes_; ++i) {
                map.at(i, i) = numbers[i];
            }
        } else if (type == "translation") {
            const std::vector<double> numbers = numbers_in(one, member(one, "translation"), axes_);
            for (std::size_t i = 0; i < axes_; ++i) {
                map.at(i, axes_) = numbers[i];
            }
        } else if (type == "affine") {
            set_rows(one, member(one, "affine"), axes_ + 1, map);
        } else if (type == "rotation") {
            set_rows(one, member(one, "rotation"), axes_, map);
        } else if (type == "sequence" && member(one, "transformations").is_array() &&
                   depth < kDeepest) {
            apply_all(member(one, "transformations"), depth + 1);
            return;
        } else if (type != "identity") {
            refuse(one, "identity, scale, translation, rotation, affine and sequences of them are");
        }
        coordinates_.map = coordinates_.map.then(map);
        coordinates_.says_scale = coordinates_.says_scale || type == "scale" || type == "affine";
    }

    [[noreturn]] void refuse(const json& one, const std::string& supported) const {
        throw Error(ErrorKind::unsupported, {name_, "coordinateTransformations"},
                    fmt::format("{:.120} is not supported; {}", one.dump(), supported),
                    {{RemedyKind::place_in_world, "spacing"}});
    }

  private:
    [[nodiscard]] std::vector<double> numbers_in(const json& one, const json& list,
                                                 std::size_t count) const {
        const bool has_numbers =
            list.is_array() && list.size() == count &&
            std::all_of(list.begin(), list.end(), [](const json& n) { return n.is_number(); });
        if (!has_numbers) {
            refuse(one, member(one, "path").is_string()
                            ? "numbers in the description itself are"
                            : fmt::format("numbers for each of the {} axes are", axes_));
        }
        return list.get<std::vector<double>>();
    }

    void set_rows(const json& one, const json& rows, std::size_t columns, AxisMap& map) const {
        if (rows.is_array() && rows.size() != axes_) {
            refuse(one, fmt::format("a matrix with a row for each of the {} axes is", axes_));
        }
        for (std::size_t row = 0; row < axes_; ++row) {
            const std::vector<double> numbers =
                numbers_in(one, rows.is_array() ? rows[row] : json(), columns);
            for (std::size_t column = 0; column < columns; ++column) {
                map.at(row, column) = numbers[column];
            }
        }
    }

    OmeCoordinates& coordinates_;
    std::size_t axes_;
    const std::string& name_;
};

/// None unless there are as many as the array has. Old versions give names alone.
std::vector<OmeAxis> axes_of(const json& list, std::size_t count) {
    std::vector<OmeAxis> axes;
    for (const json& axis : list.is_array() ? list : json::array()) {
        axes.push_back({text_of(axis.is_string() ? axis : member(axis, "name")),
                        text_of(member(axis, "type")), text_of(member(axis, "unit"))});
    }
    return axes.size() == count ? axes : std::vector<OmeAxis>{};
}

/// The name of an input or output: itself, or its member "name".
std::string system_of(const json& transformation, const char* end) {
    const json& system = member(transformation, end);
    return text_of(system.is_object() ? member(system, "name") : system);
}

std::vector<OmeAxis> axes_of_system(const json& image, const std::string& system,
                                    std::size_t count) {
    for (const json& one : entries(image, "coordinateSystems")) {
        if (text_of(member(one, "name")) == system) {
            return axes_of(member(one, "axes"), count);
        }
    }
    return {};
}

/// Since 0.6.
void add_coordinate_systems(const json& image, const json& dataset, std::size_t axes,
                            Transformations& transformations, OmeCoordinates& coordinates) {
    const json& own = entries(dataset, "coordinateTransformations");
    const std::string intrinsic = own.empty() ? "" : system_of(own.back(), "output");
    coordinates.array = axes_of_system(image, intrinsic, axes);
    const json& more = entries(image, "coordinateTransformations");
    if (more.empty()) {
        return;
    }
    const std::string input = system_of(more.front(), "input");
    if (!input.empty() && !intrinsic.empty() && input != intrinsic) {
        transformations.refuse(
            more.front(),
            fmt::format("a transformation from the array's coordinate system {:.80} is",
                        intrinsic));
    }
    transformations.apply(more.front());
    const std::string system = system_of(more.front(), "output");
    coordinates.world = axes_of_system(image, system, axes);
    std::string others;
    for (std::size_t i = 1; i < more.size(); ++i) {
        others += (i == 1 ? "" : ", ") + system_of(more[i], "output");
    }
    if (!others.empty()) {
        coordinates.notes.push_back(fmt::format(
            "placed in the coordinate system {:.80}; the image also has {:.200}", system, others));
    }
    // Positions of an array have no axes of their own.
    for (std::size_t i = 0; i < coordinates.array.size() && !coordinates.world.empty(); ++i) {
        if (coordinates.array[i].type == "array") {
            coordinates.array[i] = coordinates.world[i];
        }
    }
}

}  // namespace

OmeCoordinates ome_coordinates(const json& image, const json& dataset, std::size_t axes,
                               const std::string& name) {
    OmeCoordinates coordinates{axes_of(member(image, "axes"), axes), {}, AxisMap(axes)};
    Transformations transformations(coordinates, axes, name);
    transformations.apply_all(entries(dataset, "coordinateTransformations"));
    if (member(image, "coordinateSystems").is_array()) {
        add_coordinate_systems(image, dataset, axes, transformations, coordinates);
    } else {
        transformations.apply_all(entries(image, "coordinateTransformations"));
    }
    return coordinates;
}

}  // namespace isonest::detail
