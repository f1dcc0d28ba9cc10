#include "store/hdf5/hdf5_frame.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <string>

#include <isonest/error.h>

namespace isonest::detail {

Hdf5Frame::Hdf5Frame(const std::filesystem::path& path) : path_(path), file_(create_hdf5(path)) {
    check(file_.valid(), "create the file");
}

GroupHandle Hdf5Frame::group(hid_t where, const char* name) const {
    const PropertyHandle creation(H5Pcreate(H5P_GROUP_CREATE));
    H5Pset_obj_track_times(creation.get(), false);
    GroupHandle made(H5Gcreate2(where, name, H5P_DEFAULT, creation.get(), H5P_DEFAULT));
    check(made.valid(), "create a group");
    return made;
}

std::uint64_t Hdf5Frame::array(hid_t where, const char* name, hid_t type,
                               const std::vector<hsize_t>& dims) const {
    const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_obj_track_times(creation.get(), false);
    H5Pset_alloc_time(creation.get(), H5D_ALLOC_TIME_EARLY);
    H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
    const SpaceHandle space(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr));
    const DatasetHandle made(
        H5Dcreate2(where, name, type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT));
    check(made.valid(), "create a dataset");
    for (const hsize_t n : dims) {
        if (n == 0) {
            return 0;
        }
    }
    const haddr_t offset = H5Dget_offset(made.get());
    check(offset != HADDR_UNDEF, "allocate a dataset");
    return offset;
}

void Hdf5Frame::number(hid_t where, const char* name, std::uint64_t value) const {
    static_cast<void>(array(where, name, H5T_STD_I64LE, {1}));
    DatasetHandle made(H5Dopen2(where, name, H5P_DEFAULT));
    const auto stored = static_cast<std::int64_t>(value);
    check(H5Dwrite(made.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &stored) >= 0 &&
              made.close(),  // until then HDF5 may keep it back
          "write a dataset");
}

void Hdf5Frame::close() {
    check(file_.close(), "write the file");
}

void Hdf5Frame::check(bool good, const char* what) const {
    if (!good) {
        const int error = errno;
        const std::string why = hdf5_message();
        throw Error(ErrorKind::io, {path_.string()},
                    fmt::format("cannot {}: {}", what, why.empty() ? std::strerror(error) : why));
    }
}

}  // namespace isonest::detail
