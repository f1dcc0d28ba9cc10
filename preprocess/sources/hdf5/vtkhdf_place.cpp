#include "preprocess/sources/hdf5/vtkhdf_place.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "preprocess/sources/hdf5/hdf5_axes.h"
#include "preprocess/sources/placement/vtk_grid.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

std::optional<Placement> vtkhdf_place(hid_t file, const std::string& dataset, const Int3& nodes,
                                      bool straight, const std::string& name, std::string& lost) {
    std::string_view path = dataset;
    path.remove_prefix(path.starts_with('/') ? 1 : 0);
    const bool of_cells = path.starts_with("VTKHDF/CellData/");
    if (!of_cells && !path.starts_with("VTKHDF/PointData/")) {
        return std::nullopt;
    }
    const QuietHdf5 quiet;
    const GroupHandle group(H5Gopen2(file, "VTKHDF", H5P_DEFAULT));
    if (!group.valid() || text_of_attribute(group.get(), "Type") != "ImageData") {
        return std::nullopt;
    }
    const std::vector<double> extent = numbers_of_attribute(group.get(), "WholeExtent");
    const std::vector<double> origin = numbers_of_attribute(group.get(), "Origin");
    const std::vector<double> spacing = numbers_of_attribute(group.get(), "Spacing");
    const std::vector<double> direction = numbers_of_attribute(group.get(), "Direction");
    VtkGrid grid;
    if (extent.size() != 6 || origin.size() != 3 || spacing.size() != 3 ||
        (!direction.empty() && direction.size() != grid.direction.size())) {
        return std::nullopt;
    }
    std::copy(direction.begin(), direction.end(), grid.direction.begin());
    std::copy(spacing.begin(), spacing.end(), grid.spacing.begin());
    Double3 first{origin[0], origin[1], origin[2]};
    std::array<Double3, 3> steps{};
    for (std::size_t a = 0; a < 3; ++a) {
        const double low = extent[2 * a];
        const double high = extent[2 * a + 1];
        const bool between = of_cells && high > low;
        const auto count = static_cast<double>(nodes[static_cast<int>(a)]);
        if (high - low + (between ? 0 : 1) != count) {
            return std::nullopt;
        }
        steps.at(a) = grid.step(a);
        to_first_sample(first, steps.at(a), low, between);
    }
    if (straight) {
        Placement place;
        place.origin = first;
        lost = lost_by_own_spacing(nodes, steps);
        return place;
    }
    return place_in_world(nodes, steps, first, name);
}

}  // namespace isonest::detail
