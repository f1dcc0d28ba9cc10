// The place of the nodes of an HDF5 dataset, from everything its file may say. Private to
// preprocess.
#pragma once

#include <hdf5.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/placement/cf_positions.h"
#include "preprocess/sources/placement/conventions.h"
#include "preprocess/sources/placement/placement.h"

namespace isonest::detail {

// What an HDF5 file says about a dataset's axes and numbers.

struct Hdf5Axis {
    std::string name;  ///< of the dimension scale, or the label; empty if there is neither
    std::vector<double> coordinates;  ///< one for each position; empty if there are none
    std::string unit;                 ///< of the scale (CF: `units`); empty if not given
};

/// One for each axis of the dataset; `dims` are the lengths. Source: HDF5 Dimension Scale
/// Specification, https://docs.hdfgroup.org/archive/support/HDF5/doc/HL/H5DS_Spec.pdf
std::vector<Hdf5Axis> hdf5_axes(hid_t dataset, const std::vector<hsize_t>& dims);

/// Whether the dataset is a dimension scale, that is, the coordinates of an axis.
bool is_dimension_scale(hid_t dataset);

/// The numbers of an attribute, up to 16; empty if it is text or does not exist.
std::vector<double> numbers_of_attribute(hid_t object, const std::string& name);

/// Text of fixed or variable length; empty if the attribute is not text.
std::string text_of_attribute(hid_t object, const char* name);

/// NetCDF's `_Unsigned`: the stored signed integers are to be read as unsigned.
bool is_said_unsigned(hid_t dataset);

// The place of VTK images in HDF5.

/// For an array [z, y, x] of points or of cells (their centres) of an image in the group VTKHDF;
/// none for other datasets, and if the array does not have the image's extent. `straight`: ignores
/// the image's directions and uses a spacing of 1. Throws like place_in_world().
/// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
std::optional<Placement> vtkhdf_place(hid_t file, const std::string& dataset, const Int3& nodes,
                                      bool straight, const std::string& name, std::string& lost);

struct Hdf5Place {
    Placement in_world = {};
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<std::string> notes = {};  ///< about coordinates and units that are not used
    std::array<bool, 3> said{};           ///< whether the file gives the spacing along x, y and z
    UnevenCoordinates uneven = {};
};

struct NamedDataset {
    hid_t file;
    hid_t dataset;
    std::string path;  ///< in the file
    std::string name;  ///< for messages
};

/// `axes`: of the dataset, from hdf5_axes(). In increasing priority: coordinates of the axes,
/// `element_size_um`, a VTK image, and the attributes `spacing`, `origin`, `direction`, `unit`,
/// `frame` (RAS or LPS). If `options` give a spacing, nothing is refused because of the file's
/// spacing. Throws like place_in_world() and place_by_coordinates().
Hdf5Place hdf5_place(const NamedDataset& of, const DatasetShape& shape,
                     const std::vector<Hdf5Axis>& axes, const SourceOptions& options);

/// The datasets that give the `nodes` of a volume [z, y, x] their positions, as paths in the file:
/// those that its attribute `coordinates` names, in its own group. Nullopt if there are none.
std::optional<CfPositions> hdf5_positions(const NamedDataset& of, const Int3& nodes);

}  // namespace isonest::detail
