#include "store/container/writing/written_file.h"

#include <fmt/format.h>

#include <isonest/error.h>

namespace isonest::detail {

namespace {

PropertyHandle without_times(hid_t kind) {
    PropertyHandle creation(H5Pcreate(kind));
    H5Pset_obj_track_times(creation.get(), false);
    return creation;
}

}  // namespace

void fail_writing(const std::filesystem::path& path, const std::string& what) {
    const std::string detail = hdf5_message();
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}{}{}", what, detail.empty() ? "" : ": ", detail));
}

GroupHandle WrittenFile::create_group(const std::string& name) const {
    GroupHandle group(H5Gcreate2(file_, name.c_str(), H5P_DEFAULT,
                                 without_times(H5P_GROUP_CREATE).get(), H5P_DEFAULT));
    if (!group.valid()) {
        fail_writing(*path_, "create a group");
    }
    return group;
}

DatasetHandle WrittenFile::create_whole(const std::string& name, const hid_t type,
                                        std::span<const hsize_t> dims) const {
    const SpaceHandle space(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr));
    DatasetHandle dataset(H5Dcreate2(file_, name.c_str(), type, space.get(), H5P_DEFAULT,
                                     without_times(H5P_DATASET_CREATE).get(), H5P_DEFAULT));
    if (!dataset.valid()) {
        fail_writing(*path_, "create " + name);
    }
    return dataset;
}

DatasetHandle WrittenFile::write_whole(const std::string& name, const hid_t type,
                                       std::span<const hsize_t> dims, const void* numbers) const {
    DatasetHandle dataset = create_whole(name, type, dims);
    if (H5Dwrite(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers) < 0) {
        fail_writing(*path_, "write " + name);
    }
    return dataset;
}

void WrittenFile::write_part(const DatasetHandle& dataset, const std::string& name,
                             const hid_t type, std::span<const hsize_t> at,
                             std::span<const hsize_t> count, const void* numbers) const {
    const SpaceHandle space(H5Dget_space(dataset.get()));
    const SpaceHandle memory(
        H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr));
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, at.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dwrite(dataset.get(), type, memory.get(), space.get(), H5P_DEFAULT, numbers) < 0) {
        fail_writing(*path_, "write " + name);
    }
}

void WrittenFile::close(DatasetHandle dataset, const std::string& name) const {
    if (!dataset.close()) {
        fail_writing(*path_, "write " + name);
    }
}

}  // namespace isonest::detail
