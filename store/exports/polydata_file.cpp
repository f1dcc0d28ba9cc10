#include "store/exports/polydata_file.h"

#include <algorithm>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "store/container/hdf5_types.h"
#include "store/hdf5/handles.h"
#include "store/hdf5/hdf5_frame.h"

namespace isonest::detail {
namespace {

/// Returns where the data begin.
std::uint64_t add_attribute(const Hdf5Frame& frame, hid_t where, const PolyDataShape::Attribute& a,
                            std::uint64_t rows) {
    std::vector<hsize_t> dims{rows};
    if (a.components > 1) {
        dims.push_back(static_cast<hsize_t>(a.components));
    }
    return frame.array(where, a.name.c_str(), a.wide ? H5T_IEEE_F64LE : H5T_IEEE_F32LE, dims);
}

}  // namespace

PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape) {
    const QuietHdf5 quiet;
    Hdf5Frame frame(path);
    GroupHandle root = frame.group(frame.file(), "VTKHDF");
    write_attribute(root.get(), "Version", std::vector<std::int64_t>{2, 0});
    write_attribute(root.get(), "Type", std::string("PolyData"));
    if (!shape.unit.empty()) {
        write_attribute(root.get(), "unit", shape.unit);
    }
    if (!shape.space.empty()) {
        write_attribute(root.get(), "SPACE", shape.space);
    }
    PolyDataOffsets offsets;
    frame.number(root.get(), "NumberOfPoints", shape.points);
    offsets.points = frame.array(root.get(), "Points", H5T_IEEE_F32LE, {shape.points, 3});
    for (const char* const name : {"Vertices", "Lines", "Strips", "Polygons"}) {
        const std::uint64_t cells = name == std::string("Polygons") ? shape.triangles : 0;
        const GroupHandle group = frame.group(root.get(), name);
        frame.number(group.get(), "NumberOfCells", cells);
        frame.number(group.get(), "NumberOfConnectivityIds", 3 * cells);
        const std::uint64_t connectivity =
            frame.array(group.get(), "Connectivity", H5T_STD_I64LE, {3 * cells});
        if (cells == 0) {
            frame.number(group.get(), "Offsets", 0);
            continue;
        }
        offsets.connectivity = connectivity;
        offsets.ends =
            frame.array(group.get(), "Offsets", H5T_STD_I64LE, {cells + 1}) + sizeof(std::int64_t);
    }
    GroupHandle of_points = frame.group(root.get(), "PointData");
    GroupHandle of_cells = frame.group(root.get(), "CellData");
    for (const PolyDataShape::Attribute& a : shape.attributes) {
        offsets.attributes.push_back(add_attribute(frame, of_points.get(), a, shape.points));
        offsets.attributes_of_triangles.push_back(
            a.of_triangles ? add_attribute(frame, of_cells.get(), a, shape.triangles) : 0);
    }
    if (shape.labels_of_triangles) {
        offsets.labels_of_triangles =
            frame.array(of_cells.get(), "BoundaryLabels", H5T_STD_I64LE, {shape.triangles, 2});
    }
    of_points.reset();
    of_cells.reset();
    root.reset();
    frame.close();
    return offsets;
}

namespace {

std::optional<PolyDataArrays::Array> find_array(hid_t root, const char* name) {
    const DatasetHandle dataset(H5Dopen2(root, name, H5P_DEFAULT));
    if (!dataset.valid()) {
        return std::nullopt;
    }
    const TypeHandle type(H5Dget_type(dataset.get()));
    const SpaceHandle space(H5Dget_space(dataset.get()));
    PolyDataArrays::Array array;
    array.offset = H5Dget_offset(dataset.get());
    array.count = static_cast<std::uint64_t>(
        std::max<hssize_t>(H5Sget_simple_extent_npoints(space.get()), 0));
    array.integers = H5Tequal(type.get(), H5T_STD_I64LE) > 0;
    array.wide = array.integers || H5Tequal(type.get(), H5T_IEEE_F64LE) > 0;
    const bool is_known = array.wide || H5Tequal(type.get(), H5T_IEEE_F32LE) > 0;
    // What has no place in the file is chunked, or empty.
    if (!is_known || (array.offset == HADDR_UNDEF && array.count > 0)) {
        return std::nullopt;
    }
    return array;
}

}  // namespace

PolyDataArrays find_polydata(const std::filesystem::path& path) {
    const QuietHdf5 quiet;
    const FileHandle file = open_hdf5(path);
    if (!file.valid()) {
        throw Error(ErrorKind::corrupt, {path.string()}, "HDF5 cannot open it",
                    {{RemedyKind::good_copy}});
    }
    const GroupHandle root(H5Gopen2(file.get(), "VTKHDF", H5P_DEFAULT));
    const auto points = root.valid() ? find_array(root.get(), "Points") : std::nullopt;
    const auto corners =
        root.valid() ? find_array(root.get(), "Polygons/Connectivity") : std::nullopt;
    auto ends = root.valid() ? find_array(root.get(), "Polygons/Offsets") : std::nullopt;
    if (!points || !corners || !ends || !ends->integers || points->integers || !corners->integers) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    "of VTKHDF files, polygons whose arrays are contiguous and little endian are "
                    "read");
    }
    // There is a 0 in front of them.
    if (ends->count > 0) {
        --ends->count;
        ends->offset += sizeof(std::int64_t);
    }
    return {*points, *corners, *ends, find_array(root.get(), "PointData/value")};
}

}  // namespace isonest::detail
