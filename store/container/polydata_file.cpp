#include "store/container/polydata_file.h"

#include <string>
#include <vector>

#include "store/container/hdf5_frame.h"
#include "store/container/hdf5_types.h"

namespace isonest::detail {

PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape) {
    const QuietHdf5 quiet;
    Hdf5Frame frame(path);
    GroupHandle root = frame.group(frame.file(), "VTKHDF");
    write_attribute(root.get(), "Version", std::vector<std::int64_t>{2, 0});
    write_attribute(root.get(), "Type", std::string("PolyData"));
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
    GroupHandle data = frame.group(root.get(), "PointData");
    for (const PolyDataShape::Attribute& a : shape.attributes) {
        std::vector<hsize_t> dims{shape.points};
        if (a.components > 1) {
            dims.push_back(static_cast<hsize_t>(a.components));
        }
        offsets.attributes.push_back(frame.array(data.get(), a.name.c_str(),
                                                 a.wide ? H5T_IEEE_F64LE : H5T_IEEE_F32LE, dims));
    }
    data.reset();
    root.reset();
    frame.close();
    return offsets;
}

}  // namespace isonest::detail
