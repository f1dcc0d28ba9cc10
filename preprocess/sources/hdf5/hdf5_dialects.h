// HDF5 dialects: the groups and attributes in which particular programs describe their data.
// Private to preprocess.
#pragma once

#include <fmt/format.h>
#include <hdf5.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>
#include <isonest/frame.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5/hdf5_place.h"
#include "preprocess/sources/placement/conventions.h"

namespace isonest::detail {

/// The dataset that is the volume of a file, and the selection on its axes.
struct DialectChoice {
    std::string dataset;
    std::vector<AxisIndex> index;
};

/// What a dialect says about one dataset. Lists have one entry for each of its axes, slowest first,
/// or are empty if the dialect does not specify them.
struct Hdf5Dialect {
    std::string name;             ///< "Imaris"
    std::vector<Hdf5Axis> axes;   ///< names, and possibly coordinates and units
    std::vector<bool> of_volume;  ///< false: channels, times, components
    bool by_names = false;        ///< axes called x, y and z are those of the world
    /// The step along each axis in world coordinates, and the place of the first value; empty:
    /// coordinates or attributes of the dataset determine it.
    std::vector<Double3> steps;
    Double3 first{0, 0, 0};
    std::vector<bool> said;  ///< for each axis, whether the file gives the step
    std::optional<LengthUnit> unit;
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<hsize_t> lengths;    ///< of the image, if the dataset is padded
    std::optional<MincRange> range;  ///< meaning of the stored numbers
};

/// Detects the dialect by the contents of the file: MINC 2, ITK, Imaris, ChimeraX, HyperSpy, Velox.
/// None for other files, and if there are several images. `index` is the user's. Throws
/// Error{corrupt, not_found}, naming the dialect, if its image is missing, and what choose_axes()
/// throws if an image is chosen by an index.
std::optional<DialectChoice> dialect_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index);

/// What the dialect says about the dataset, also if the user has named the dataset; also supports
/// ilastik and the EMD format of Berkeley. `dims`: its lengths. `with_spacing`: the user gives one.
/// Throws Error{corrupt, unsupported}, naming the dialect.
std::optional<Hdf5Dialect> dialect_of(const NamedDataset& of, const std::vector<hsize_t>& dims,
                                      bool with_spacing);

/// The place of the dataset in the world. Throws like place_in_world().
Hdf5Place place_by_dialect(const Hdf5Dialect& dialect, const DatasetShape& shape, const Int3& nodes,
                           bool with_spacing, const std::string& name);

// The functions of each dialect for the two questions above.

/// The arguments of dialect_of(), for one dataset.
struct DialectQuestion {
    const NamedDataset& of;
    const std::vector<std::string>& path;  ///< in the file
    const std::vector<hsize_t>& dims;
    bool with_spacing;
};

std::optional<DialectChoice> minc_choice(hid_t file, const std::string& name,
                                         const std::vector<AxisIndex>& index);
std::optional<DialectChoice> itk_choice(hid_t file, const std::string& name,
                                        const std::vector<AxisIndex>& index);
std::optional<DialectChoice> imaris_choice(hid_t file, const std::string& name,
                                           const std::vector<AxisIndex>& index);
std::optional<DialectChoice> chimera_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index);
std::optional<DialectChoice> hyperspy_choice(hid_t file, const std::string& name,
                                             const std::vector<AxisIndex>& index);
std::optional<DialectChoice> velox_choice(hid_t file, const std::string& name,
                                          const std::vector<AxisIndex>& index);

std::optional<Hdf5Dialect> minc_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> itk_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> imaris_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> chimera_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> hyperspy_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> velox_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> ilastik_dialect(const DialectQuestion& asked);
std::optional<Hdf5Dialect> emd_dialect(const DialectQuestion& asked);

/// Throws because the file is of this dialect, but something it requires is missing or wrong.
[[noreturn]] inline void refuse_dialect(std::string_view dialect, const std::string& name,
                                        const std::string& problem) {
    throw Error(ErrorKind::corrupt, {name}, fmt::format("this is {}, but {}", dialect, problem));
}

}  // namespace isonest::detail
