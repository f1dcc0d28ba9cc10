#include "preprocess/sources/hdf5/hdf5_dialects.h"

#include <algorithm>

#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "store/hdf5/handles.h"

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
    // Whole axes that are not directions in space are placed at right angles to the others, 1
    // apart.
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

// MINC 2 and ITK's images in HDF5. Sources:
// https://en.wikibooks.org/wiki/MINC/Reference/MINC2.0_File_Format_Reference and
// https://github.com/InsightSoftwareConsortium/ITK/blob/master/Modules/IO/HDF5/src/itkHDF5ImageIO.cxx

namespace {

constexpr const char* kMinc = "MINC 2";
constexpr const char* kItk = "an ITK image";

std::vector<std::string> names_of_dimorder(hid_t dataset, std::size_t count) {
    const std::string text = joined_text(dataset, "dimorder");
    std::vector<std::string> names;
    for (std::size_t at = 0; at < text.size() && names.size() < count;) {
        const std::size_t end = std::min(text.find(',', at), text.size());
        names.push_back(text.substr(at, end - at));
        at = end + 1;
    }
    return names;
}

/// image-min or image-max, and the number of image axes it has.
std::vector<double> range_of(const DialectQuestion& asked, const char* which,
                             const std::vector<std::string>& names, std::size_t& dims) {
    const std::string path = fmt::format("minc-2.0/image/0/{}", which);
    const ObjectHandle dataset = open_inside(asked.of.file, path);
    if (!is_dataset(dataset)) {
        return {};
    }
    std::vector<double> numbers = numbers_inside(asked.of.file, path, kMaxMincRanges);
    const DatasetShape shape = shape_of(dataset.get());
    const auto own = names_of_dimorder(dataset.get(), shape.dims.size());
    dims = shape.dims.size();
    if (numbers.empty() || dims > names.size() ||
        !std::equal(shape.dims.begin(), shape.dims.end(), asked.dims.begin()) ||
        (!own.empty() &&
         (own.size() != dims || !std::equal(own.begin(), own.end(), names.begin())))) {
        refuse_dialect(
            kMinc, asked.of.name,
            fmt::format("{} does not have numbers along the leading axes of the image", path));
    }
    return numbers;
}

}  // namespace

std::optional<DialectChoice> minc_choice(hid_t file, const std::string& name,
                                         const std::vector<AxisIndex>& index) {
    if (!is_group(open_inside(file, "minc-2.0"))) {
        return std::nullopt;
    }
    const std::string path = "/minc-2.0/image/0/image";
    if (!is_dataset(open_inside(file, path))) {
        refuse_dialect(kMinc, name, "there is no image (" + path + ")");
    }
    return DialectChoice{path, index};
}

std::optional<Hdf5Dialect> minc_dialect(const DialectQuestion& asked) {
    const std::vector<std::string>& path = asked.path;
    if (path.size() != 4 || path[0] != "minc-2.0" || path[1] != "image" || path[3] != "image") {
        return std::nullopt;
    }
    if (path[2] != "0") {
        throw Error(
            ErrorKind::unsupported, {asked.of.name},
            "this is a MINC 2 image of lower resolution; the full image is /minc-2.0/image/0/image",
            {{RemedyKind::choose_dataset}});
    }
    const std::vector<std::string> names = names_of_dimorder(asked.of.dataset, asked.dims.size());
    if (names.size() != asked.dims.size()) {
        refuse_dialect(kMinc, asked.of.name, "dimorder of the image does not name its axes");
    }
    std::vector<MincDimension> dims;
    for (std::size_t i = 0; i < names.size(); ++i) {
        MincDimension dim{names[i], static_cast<std::int64_t>(asked.dims[i])};
        if (const ObjectHandle said = open_inside(asked.of.file, "minc-2.0/dimensions/" + names[i]);
            is_dataset(said)) {
            dim.start = numbers_of_attribute(said.get(), "start");
            dim.step = numbers_of_attribute(said.get(), "step");
            dim.cosines = numbers_of_attribute(said.get(), "direction_cosines");
            dim.spacing = joined_text(said.get(), "spacing");
            dim.units = joined_text(said.get(), "units");
        }
        dims.push_back(std::move(dim));
    }
    const MincPlace place = minc_place(dims, asked.with_spacing, asked.of.name);
    Hdf5Dialect dialect;
    dialect.name = kMinc;
    for (const ArrayAxis& axis : place.axes) {
        dialect.axes.push_back({axis.name, {}, ""});
        dialect.of_volume.push_back(axis.of_volume);
    }
    dialect.steps = place.steps;
    dialect.first = place.first;
    dialect.said = place.said;
    dialect.unit = place.unit;
    dialect.frame = AnatomicalFrame::ras;
    MincRange range;
    std::size_t of_least = 0;
    range.most = range_of(asked, "image-max", names, range.dims);
    range.least = range_of(asked, "image-min", names, of_least);
    if (of_least != range.dims || range.most.size() != range.least.size()) {
        refuse_dialect(kMinc, asked.of.name, "image-min and image-max have different axes");
    }
    range.valid = numbers_of_attribute(asked.of.dataset, "valid_range");
    if (range.valid.size() != 2) {
        range.valid = numbers_of_attribute(asked.of.dataset, "valid_min");
        const auto most = numbers_of_attribute(asked.of.dataset, "valid_max");
        range.valid.insert(range.valid.end(), most.begin(), most.end());
    }
    dialect.range = std::move(range);
    return dialect;
}

std::optional<DialectChoice> itk_choice(hid_t file, const std::string& name,
                                        const std::vector<AxisIndex>& index) {
    if (!is_group(open_inside(file, "ITKImage"))) {
        return std::nullopt;
    }
    const std::string path = "/ITKImage/0/VoxelData";
    if (!is_dataset(open_inside(file, path))) {
        refuse_dialect(kItk, name, "there are no values (" + path + ")");
    }
    return DialectChoice{path, index};
}

/// ITK counts axes from the fastest. HDF5 has a last axis for components, if there are any.
std::optional<Hdf5Dialect> itk_dialect(const DialectQuestion& asked) {
    const std::vector<std::string>& path = asked.path;
    if (path.size() != 3 || path[0] != "ITKImage" || path[2] != "VoxelData") {
        return std::nullopt;
    }
    constexpr std::size_t kMax = 64;
    const std::string group = path[0] + "/" + path[1] + "/";
    const hid_t file = asked.of.file;
    const std::vector<double> lengths = numbers_inside(file, group + "Dimension", kMax);
    const std::vector<double> origin = numbers_inside(file, group + "Origin", kMax);
    const std::vector<double> spacing = numbers_inside(file, group + "Spacing", kMax);
    // One row per axis: its direction in the world.
    const std::vector<double> directions = numbers_inside(file, group + "Directions", kMax);
    const std::size_t count = spacing.size();
    if (count < 1 || origin.size() != count || directions.size() != count * count ||
        lengths.size() != count) {
        refuse_dialect(kItk, asked.of.name,
                       fmt::format("the numbers in {0}Origin, {0}Spacing, {0}Directions and "
                                   "{0}Dimension do not match the number of axes",
                                   group));
    }
    const bool components = asked.dims.size() == count + 1;
    for (std::size_t i = 0; i < count; ++i) {
        if ((asked.dims.size() != count && !components) ||
            static_cast<double>(asked.dims[count - 1 - i]) != lengths[i]) {
            refuse_dialect(kItk, asked.of.name,
                           fmt::format("{}Dimension does not match the size of the values", group));
        }
    }
    Hdf5Dialect dialect;
    dialect.name = kItk;
    dialect.frame = AnatomicalFrame::lps;
    constexpr std::array<const char*, 4> kNames{"x", "y", "z", "t"};
    for (std::size_t d = 0; d < asked.dims.size(); ++d) {
        const bool is_axis = d < count;
        const std::size_t i = is_axis ? count - 1 - d : 0;
        dialect.axes.push_back({!is_axis ? "component" : i < 4 ? kNames.at(i) : "", {}, ""});
        dialect.of_volume.push_back(is_axis && i < 3);
        Double3 step{0, 0, 0};
        for (std::size_t w = 0; w < std::min<std::size_t>(count, 3) && is_axis && i < 3; ++w) {
            step.at(w) = spacing[i] * directions[i * count + w];
        }
        dialect.steps.push_back(step);
        dialect.said.push_back(true);
    }
    std::copy_n(origin.begin(), std::min<std::size_t>(count, 3), dialect.first.begin());
    return dialect;
}

}  // namespace isonest::detail
