#include "store/container/polydata_file.h"

#include <fmt/format.h>

#include <isonest/error.h>

#include "store/container/handles.h"

namespace isonest::detail {
namespace {

class Frame {
  public:
    explicit Frame(const std::filesystem::path& path) : path_(path) {
        file_ = create_hdf5(path);
        check(file_.valid(), "create the file");
        root_ = group(file_.get(), "VTKHDF");
        const std::vector<std::int64_t> version{2, 0};
        const hsize_t two = 2;
        const SpaceHandle pair(H5Screate_simple(1, &two, nullptr));
        const AttributeHandle v(H5Acreate2(root_.get(), "Version", H5T_STD_I64LE, pair.get(),
                                           H5P_DEFAULT, H5P_DEFAULT));
        check(H5Awrite(v.get(), H5T_NATIVE_INT64, version.data()) >= 0, "write an attribute");
        const std::string type = "PolyData";
        const TypeHandle text(H5Tcopy(H5T_C_S1));
        H5Tset_size(text.get(), type.size());
        H5Tset_strpad(text.get(), H5T_STR_NULLPAD);
        const SpaceHandle scalar(H5Screate(H5S_SCALAR));
        const AttributeHandle t(
            H5Acreate2(root_.get(), "Type", text.get(), scalar.get(), H5P_DEFAULT, H5P_DEFAULT));
        check(H5Awrite(t.get(), text.get(), type.data()) >= 0, "write an attribute");
    }

    [[nodiscard]] hid_t root() const { return root_.get(); }

    GroupHandle group(hid_t where, const char* name) {
        const PropertyHandle creation(H5Pcreate(H5P_GROUP_CREATE));
        H5Pset_obj_track_times(creation.get(), false);
        GroupHandle made(H5Gcreate2(where, name, H5P_DEFAULT, creation.get(), H5P_DEFAULT));
        check(made.valid(), "create a group");
        return made;
    }
    /// Returns where the data begin; 0 for an array without elements.
    std::uint64_t array(hid_t where, const char* name, hid_t type, std::vector<hsize_t> dims) {
        const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
        H5Pset_obj_track_times(creation.get(), false);
        H5Pset_alloc_time(creation.get(), H5D_ALLOC_TIME_EARLY);
        H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
        const SpaceHandle space(
            H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr));
        const DatasetHandle made(
            H5Dcreate2(where, name, type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT));
        check(made.valid(), "create a dataset");
        if (dims[0] == 0) {
            return 0;
        }
        const haddr_t offset = H5Dget_offset(made.get());
        check(offset != HADDR_UNDEF, "allocate a dataset");
        return offset;
    }
    void number(hid_t where, const char* name, std::uint64_t value) {
        static_cast<void>(array(where, name, H5T_STD_I64LE, {1}));
        const DatasetHandle made(H5Dopen2(where, name, H5P_DEFAULT));
        const auto stored = static_cast<std::int64_t>(value);
        check(H5Dwrite(made.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &stored) >= 0,
              "write a dataset");
    }
    void close() {
        root_.reset();
        check(file_.close(), "write the file");
    }

  private:
    void check(bool good, const char* what) const {
        if (!good) {
            throw Error(ErrorKind::io, {path_.string()},
                        fmt::format("cannot {}: {}", what, hdf5_message()));
        }
    }
    std::filesystem::path path_;
    FileHandle file_;
    GroupHandle root_;
};

}  // namespace

PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape) {
    const QuietHdf5 quiet;
    Frame frame(path);
    PolyDataOffsets offsets;
    frame.number(frame.root(), "NumberOfPoints", shape.points);
    offsets.points = frame.array(frame.root(), "Points", H5T_IEEE_F32LE, {shape.points, 3});
    for (const char* const name : {"Vertices", "Lines", "Strips", "Polygons"}) {
        const std::uint64_t cells = name == std::string("Polygons") ? shape.triangles : 0;
        const GroupHandle group = frame.group(frame.root(), name);
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
    const GroupHandle data = frame.group(frame.root(), "PointData");
    for (const PolyDataShape::Attribute& a : shape.attributes) {
        std::vector<hsize_t> dims{shape.points};
        if (a.components > 1) {
            dims.push_back(static_cast<hsize_t>(a.components));
        }
        offsets.attributes.push_back(frame.array(data.get(), a.name.c_str(),
                                                 a.wide ? H5T_IEEE_F64LE : H5T_IEEE_F32LE, dims));
    }
    frame.close();
    return offsets;
}

}  // namespace isonest::detail
