// Owning HDF5 handles, and exceptions for HDF5 failures. Private to the store.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace isonest::detail {

/// Starts HDF5, once, if there is enough memory: HDF5 crashes if it runs out of memory while
/// starting. The first HDF5 call must come after this call, or in the scope of a QuietHdf5. Throws
/// std::bad_alloc; never throws once HDF5 has started.
void start_hdf5();

/// Starts HDF5, and disables its error output on stderr in the calling thread, for a scope.
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
    /// Closes and returns whether that succeeded; for handles whose failure to close means lost
    /// data.
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

/// If an allocation fails while HDF5 opens or creates a file, HDF5 uses the null pointer, and ends
/// the program (1.10.8, H5AC_create). Throws std::bad_alloc if there is not enough memory for that.
void require_heap_to_open_hdf5();

/// Opens for reading, without a lock: reading through a map needs none, and some network and
/// read-only file systems refuse it. The handle is invalid if HDF5 fails.
FileHandle open_hdf5(const std::filesystem::path& path);

/// The properties of files that we write: HDF5 1.10 objects (with checksums of metadata), and no
/// lock, because nobody else knows the temporary name.
PropertyHandle written_file_access();
/// Creates a new file, without timestamps, so that its bytes are reproducible. The handle is
/// invalid if HDF5 fails.
FileHandle create_hdf5(const std::filesystem::path& path,
                       const PropertyHandle& access = written_file_access());

/// The innermost description on HDF5's error stack, or an empty text. For a failed system call,
/// what failed and the system's message.
std::string hdf5_message();

/// "HDF5 cannot open it", with that description if there is one. To be called after open_hdf5().
std::string hdf5_cannot_open();

// A new HDF5 file whose arrays are allocated at once and filled in place later.

/// All arrays are contiguous. Members throw Error{io}. Not thread-safe.
class Hdf5Frame {
  public:
    /// REQUIRES: the file does not exist.
    explicit Hdf5Frame(const std::filesystem::path& path);

    [[nodiscard]] hid_t file() const { return file_.get(); }
    /// `ordered`: its links remember in which order they were made.
    [[nodiscard]] GroupHandle group(hid_t where, const char* name, bool ordered = false) const;
    /// A link by its path, as "/VTKHDF/a".
    void soft_link(hid_t where, const char* name, const char* to) const;
    /// Returns the offset of the data; 0 for an array without elements.
    [[nodiscard]] std::uint64_t array(hid_t where, const char* name, hid_t type,
                                      const std::vector<hsize_t>& dims) const;
    /// Writes an array of one integer.
    void number(hid_t where, const char* name, std::uint64_t value) const;
    /// REQUIRES: all groups are closed.
    void close();

  private:
    void check(bool good, const char* what) const;

    std::filesystem::path path_;
    FileHandle file_;
};

}  // namespace isonest::detail
