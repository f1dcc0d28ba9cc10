#include "store/hdf5/handles.h"

#include <cstddef>
#include <cstdlib>
#include <new>
#include <string_view>

namespace isonest::detail {

void require_heap_to_open_hdf5() {
    // Measured: 2.4 MB where nothing of HDF5 is in memory yet.
    constexpr std::size_t kEnough = std::size_t{4} << 20U;
    void* volatile const room = std::malloc(kEnough);  // volatile: else it would be left out
    if (room == nullptr) {
        throw std::bad_alloc();
    }
    std::free(room);
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
            if (out.empty() && error->desc != nullptr) {
                out = error->desc;
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

}  // namespace isonest::detail
