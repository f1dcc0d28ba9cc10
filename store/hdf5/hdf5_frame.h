// A new HDF5 file whose arrays are allocated at once, to be filled in place. Private to the store.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// All arrays are contiguous. Members throw Error{io}. Not thread-safe.
class Hdf5Frame {
  public:
    /// REQUIRES: no such file.
    explicit Hdf5Frame(const std::filesystem::path& path);

    [[nodiscard]] hid_t file() const { return file_.get(); }
    [[nodiscard]] GroupHandle group(hid_t where, const char* name) const;
    /// Returns where the data begin; 0 for an array without elements.
    [[nodiscard]] std::uint64_t array(hid_t where, const char* name, hid_t type,
                                      const std::vector<hsize_t>& dims) const;
    /// An array of one integer.
    void number(hid_t where, const char* name, std::uint64_t value) const;
    /// REQUIRES: all its groups are closed.
    void close();

  private:
    void check(bool good, const char* what) const;

    std::filesystem::path path_;
    FileHandle file_;
};

}  // namespace isonest::detail
