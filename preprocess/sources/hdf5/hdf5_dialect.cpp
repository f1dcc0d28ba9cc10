#include "preprocess/sources/hdf5/hdf5_dialect.h"

#include "preprocess/sources/hdf5/dialects.h"
#include "preprocess/sources/hdf5/hdf5_groups.h"

namespace isonest::detail {

std::optional<DialectChoice> dialect_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index) {
    for (const auto ask :
         {minc_choice, itk_choice, imaris_choice, chimera_choice, hyperspy_choice, velox_choice}) {
        if (auto choice = ask(file, name, index)) {
            return choice;
        }
    }
    return std::nullopt;
}

std::optional<Hdf5Dialect> dialect_of(const NamedDataset& of, const std::vector<hsize_t>& dims,
                                      bool with_spacing) {
    const std::vector<std::string> path = parts_of_path(of.path);
    const DialectQuestion asked{of, path, dims, with_spacing};
    for (const auto ask : {minc_dialect, itk_dialect, imaris_dialect, chimera_dialect,
                           hyperspy_dialect, velox_dialect, ilastik_dialect, emd_dialect}) {
        if (auto dialect = ask(asked)) {
            return dialect;
        }
    }
    return std::nullopt;
}

Hdf5Place place_by_dialect(const Hdf5Dialect& dialect, const DatasetShape& shape, const Int3& nodes,
                           bool with_spacing, const std::string& name) {
    Hdf5Place place;
    place.unit = dialect.unit;
    place.frame = dialect.frame;
    std::array<Double3, 3> steps{};
    Double3 first = dialect.first;
    for (std::size_t i = 0; i < shape.axes.size(); ++i) {
        const std::size_t axis = shape.axes[shape.axes.size() - 1 - i];
        steps.at(i) = dialect.steps[axis];
        place.said.at(i) = dialect.said[axis];
    }
    // Whole axes that are no directions in space lie at right angles to the others, 1 apart.
    Int3 in_space = nodes;
    for (std::size_t i = 0; i < shape.axes.size(); ++i) {
        const std::size_t axis = shape.axes[shape.axes.size() - 1 - i];
        if (!dialect.of_volume.empty() && !dialect.of_volume[axis]) {
            in_space[static_cast<int>(i)] = 1;
            steps.at(i) = {0, 0, 0};
        }
    }
    complete_steps(in_space, steps);
    for (std::size_t d = 0; d < shape.at.size(); ++d) {
        for (std::size_t w = 0; w < 3; ++w) {
            first.at(w) += dialect.steps[d].at(w) * static_cast<double>(shape.at[d]);
        }
    }
    try {
        place.in_world = place_in_world(nodes, steps, first, name);
    } catch (const Error&) {
        if (!with_spacing) {
            throw;
        }
        place.in_world.origin = first;
    }
    return place;
}

}  // namespace isonest::detail
