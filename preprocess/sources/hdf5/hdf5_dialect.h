// Dialects of HDF5: what programs of one kind say in groups and attributes of their own about the
// dataset that is the volume. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <optional>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5/hdf5_axes.h"
#include "preprocess/sources/hdf5/hdf5_place.h"
#include "preprocess/sources/placement/minc_convention.h"

namespace isonest::detail {

/// The dataset that is the volume of a file, and what is taken of its axes.
struct DialectChoice {
    std::string dataset;
    std::vector<AxisIndex> index;
};

/// What a dialect says of one dataset. Lists have an entry for each of its axes, slowest first, or
/// are empty where the dialect says nothing of the kind.
struct Hdf5Dialect {
    std::string name;             ///< "Imaris"
    std::vector<Hdf5Axis> axes;   ///< names, and perhaps coordinates and units
    std::vector<bool> of_volume;  ///< false: channels, times, components
    bool by_names = false;        ///< axes called x, y and z are those of the world
    /// The world's step along each axis, and where the first value lies; empty: coordinates or
    /// attributes of the dataset place it.
    std::vector<Double3> steps;
    Double3 first{0, 0, 0};
    std::vector<bool> said;  ///< whether the file says the step along each axis
    std::optional<LengthUnit> unit;
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<hsize_t> lengths;    ///< of the image, where the dataset is padded
    std::optional<MincRange> range;  ///< what stored numbers mean
};

/// By what is in the file: MINC 2, ITK, Imaris, ChimeraX, HyperSpy, Velox. Nothing for other files,
/// and where the dialect has several images. `index` is the user's. Throws Error{corrupt,
/// not_found}, which names the dialect, where its image is not there, and what choose_axes() throws
/// where an image is chosen by an index.
std::optional<DialectChoice> dialect_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index);

/// What is said of the dataset, also where the user has named it; besides, what ilastik and the EMD
/// of Berkeley say. `dims`: its lengths. `with_spacing`: the user gives one. Throws Error{corrupt,
/// unsupported}, which name the dialect.
std::optional<Hdf5Dialect> dialect_of(const NamedDataset& of, const std::vector<hsize_t>& dims,
                                      bool with_spacing);

/// Its place in the world. Throws as place_in_world() does.
Hdf5Place place_by_dialect(const Hdf5Dialect& dialect, const DatasetShape& shape, const Int3& nodes,
                           bool with_spacing, const std::string& name);

}  // namespace isonest::detail
