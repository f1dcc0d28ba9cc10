// What a store consists of while it is written by HDF5.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Throws Error{io} with what HDF5 says. `path`: the store's name.
[[noreturn]] void fail_writing(const std::filesystem::path& path, const std::string& what);

/// An open file, which is not this one's. Nothing in it has a time, which would make every run's
/// bytes differ. All functions throw Error{io}. Thread-safety: one thread at a time.
class WrittenFile {
  public:
    /// `path`: the store's name, for messages, which outlives this.
    WrittenFile(hid_t file, const std::filesystem::path& path) : file_(file), path_(&path) {}

    [[nodiscard]] hid_t get() const { return file_; }
    [[nodiscard]] const std::filesystem::path& path() const { return *path_; }
    GroupHandle create_group(const std::string& name) const;
    /// In one piece.
    DatasetHandle create_whole(const std::string& name, hid_t type,
                               std::span<const hsize_t> dims) const;
    DatasetHandle write_whole(const std::string& name, hid_t type, std::span<const hsize_t> dims,
                              const void* numbers) const;
    /// `count` numbers from `at` on of a dataset of this file. `name`: what could not be written.
    void write_part(const DatasetHandle& dataset, const std::string& name, hid_t type,
                    std::span<const hsize_t> at, std::span<const hsize_t> count,
                    const void* numbers) const;
    /// Closes it. HDF5 keeps small writes back until then, so that only this says whether the disk
    /// has taken them. `name`: what could not be written.
    void close(DatasetHandle dataset, const std::string& name) const;

  private:
    hid_t file_;
    const std::filesystem::path* path_;
};

}  // namespace isonest::detail
