#include "store/hdf5/handles.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <new>
#include <string>
#include <string_view>

#include <isonest/error.h>

#include "store/base/memory.h"

namespace isonest::detail {

void require_heap_to_open_hdf5() {
    // Measured: 2.4 MB if no part of HDF5 has been loaded yet.
    require_free_heap(std::size_t{4} << 20U);
}

void start_hdf5() {
    static const bool has_started = [] {
        require_heap_to_open_hdf5();
        if (H5open() < 0) {
            throw std::bad_alloc();
        }
        return true;
    }();
    static_cast<void>(has_started);
}

FileHandle open_hdf5(const std::filesystem::path& path) {
    start_hdf5();
    require_heap_to_open_hdf5();
    const PropertyHandle access(H5Pcreate(H5P_FILE_ACCESS));
    H5Pset_file_locking(access.get(), false, true);
    return FileHandle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()));
}

PropertyHandle written_file_access() {
    start_hdf5();
    PropertyHandle access(H5Pcreate(H5P_FILE_ACCESS));
    H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110);
    H5Pset_file_locking(access.get(), false, true);
    return access;
}

FileHandle create_hdf5(const std::filesystem::path& path, const PropertyHandle& access) {
    require_heap_to_open_hdf5();
    const PropertyHandle creation(H5Pcreate(H5P_FILE_CREATE));
    H5Pset_obj_track_times(creation.get(), false);
    return FileHandle(H5Fcreate(path.c_str(), H5F_ACC_EXCL, creation.get(), access.get()));
}

std::string hdf5_message() {
    std::string text;
    H5Ewalk2(
        H5E_DEFAULT, H5E_WALK_UPWARD,
        [](unsigned, const H5E_error2_t* error, void* data) -> herr_t {
            auto& out = *static_cast<std::string*>(data);
            // For a link to another file, the name of that file is the most useful part.
            const std::string_view said = error->desc != nullptr ? error->desc : "";
            if (out.empty() || said.find("external link file name") != std::string_view::npos) {
                out = said;
            }
            return 0;
        },
        &text);
    // "file write failed: time = ..., errno = 28, error message = 'No space left on device', ..."
    constexpr std::string_view kMessage = "error message = '";
    const std::size_t message = text.find(kMessage);
    const std::size_t what = text.find(':');
    if (message != std::string::npos && what < message) {
        const std::size_t begin = message + kMessage.size();
        return text.substr(0, what) + ": " + text.substr(begin, text.find('\'', begin) - begin);
    }
    return text;
}

std::string hdf5_cannot_open() {
    const std::string why = hdf5_message();
    return "HDF5 cannot open it" + (why.empty() ? "" : " (" + why + ")");
}

Hdf5Frame::Hdf5Frame(const std::filesystem::path& path) : path_(path), file_(create_hdf5(path)) {
    check(file_.valid(), "create the file");
}

GroupHandle Hdf5Frame::group(hid_t where, const char* name, bool ordered) const {
    const PropertyHandle creation(H5Pcreate(H5P_GROUP_CREATE));
    H5Pset_obj_track_times(creation.get(), false);
    if (ordered) {
        H5Pset_link_creation_order(creation.get(), H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED);
    }
    GroupHandle made(H5Gcreate2(where, name, H5P_DEFAULT, creation.get(), H5P_DEFAULT));
    check(made.valid(), "create a group");
    return made;
}

void Hdf5Frame::soft_link(hid_t where, const char* name, const char* to) const {
    check(H5Lcreate_soft(to, where, name, H5P_DEFAULT, H5P_DEFAULT) >= 0, "create a link");
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
              made.close(),  // HDF5 may buffer it until then
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
