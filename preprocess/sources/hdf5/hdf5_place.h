// Where the nodes of an HDF5 dataset lie, by all that its file may say. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5/hdf5_axes.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/placement/placement.h"

namespace isonest::detail {

struct Hdf5Place {
    Placement in_world = {};
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<std::string> notes = {};  ///< of coordinates and units that are not taken
    std::array<bool, 3> said{};           ///< whether the file says the spacing, along x, y and z
};

struct NamedDataset {
    hid_t file;
    hid_t dataset;
    std::string path;  ///< in the file
    std::string name;  ///< for messages
};

/// `axes`: of the dataset, as hdf5_axes() gives them. What is said later counts more: even
/// coordinates of the axes, `element_size_um`, an image of VTK's, and the attributes `spacing`,
/// `origin`, `direction`, `unit`, `frame` (RAS or LPS). Of `options` the spacing is looked at, where
/// it is given: then nothing is refused for its own. Throws as place_in_world() and
/// place_by_coordinates() do.
Hdf5Place hdf5_place(const NamedDataset& of, const DatasetShape& shape,
                     const std::vector<Hdf5Axis>& axes, const SourceOptions& options);

}  // namespace isonest::detail
