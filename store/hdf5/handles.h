// Owning HDF5 handles, and HDF5 failures as exceptions. Private to the store.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <string>
#include <utility>

namespace isonest::detail {

/// Starts HDF5, once, where there is memory for it: where memory ends while it starts, it crashes.
/// Whatever calls HDF5 first does so after this, or in the scope of a QuietHdf5. Throws
/// std::bad_alloc; nothing once HDF5 has started.
void start_hdf5();

/// Starts HDF5, and silences its printing on stderr for a scope of the calling thread.
class QuietHdf5 {
  public:
    QuietHdf5() {
        start_hdf5();
        H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
        H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    }
    QuietHdf5(const QuietHdf5&) = delete;
    QuietHdf5& operator=(const QuietHdf5&) = delete;
    ~QuietHdf5() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }

  private:
    H5E_auto2_t function_ = nullptr;
    void* data_ = nullptr;
};

/// Owns one HDF5 identifier; `Close` is the matching close function.
template <herr_t (*Close)(hid_t)>
class Handle {
  public:
    Handle() = default;
    explicit Handle(hid_t id) : id_(id) {}
    Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
    Handle& operator=(Handle&& other) noexcept {
        if (this != &other) {
            reset();
            id_ = std::exchange(other.id_, H5I_INVALID_HID);
        }
        return *this;
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    ~Handle() { reset(); }
    void reset() {
        if (id_ >= 0) {
            const QuietHdf5 quiet;
            static_cast<void>(close());
        }
    }
    /// Closes and reports whether that worked, where a failure means lost data.
    [[nodiscard]] bool close() { return Close(std::exchange(id_, H5I_INVALID_HID)) >= 0; }
    [[nodiscard]] hid_t get() const { return id_; }
    [[nodiscard]] bool valid() const { return id_ >= 0; }

  private:
    hid_t id_ = H5I_INVALID_HID;
};

using FileHandle = Handle<H5Fclose>;
using GroupHandle = Handle<H5Gclose>;
using DatasetHandle = Handle<H5Dclose>;
using SpaceHandle = Handle<H5Sclose>;
using TypeHandle = Handle<H5Tclose>;
using AttributeHandle = Handle<H5Aclose>;
using PropertyHandle = Handle<H5Pclose>;

/// HDF5 uses what it could not allocate while it opens or creates a file, and ends the program
/// (1.10.8, H5AC_create). Throws std::bad_alloc where there is no room for that.
void require_heap_to_open_hdf5();

/// Opens for reading, without a lock: what is read through a map needs none, and some network and
/// read-only file systems refuse one. Invalid where HDF5 cannot open it.
FileHandle open_hdf5(const std::filesystem::path& path);

/// The properties of files that we write: HDF5 1.10 objects (their metadata have checksums), and no
/// lock, because nobody else knows a temporary name.
PropertyHandle written_file_access();
/// Creates a file that is not there yet, without times, so that its bytes are the same at any time.
/// Invalid where HDF5 cannot.
FileHandle create_hdf5(const std::filesystem::path& path,
                       const PropertyHandle& access = written_file_access());

/// The innermost description on HDF5's error stack, or an empty text. Of a failing system call,
/// what failed and the system's message.
std::string hdf5_message();

/// "HDF5 cannot open it", with that description if there is one. After open_hdf5().
std::string hdf5_cannot_open();

}  // namespace isonest::detail
