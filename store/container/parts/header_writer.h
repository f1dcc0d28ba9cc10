// Writes the attributes that describe a store: see FORMAT.md. Private to the store.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <isonest/label_name.h>

#include "store/container/format.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Writes the attributes of the root group that are known before any chunk; the version and the
/// flags as if some chunks were not shuffled. Throws Error{io}.
void write_header(hid_t root, const StoreHeader& header);
/// Writes these two again. Throws Error{io}.
void write_version_and_flags(hid_t root, const StoreHeader& header);

/// Writes what the header says of the positions of a curvilinear grid. Throws Error{io}.
void write_curved(hid_t root, const CurvedNodes& nodes);

/// Writes the attributes of the group /VTKHDF, which tell ParaView the position of the image.
/// Throws Error{io}.
void write_vtk_attributes(hid_t group, const StoreHeader& header);

/// VTK's direction matrix, row by row; its columns are the axes.
std::vector<double> vtk_direction(const Directions& direction);

// The parts of a store while it is written by HDF5.

/// Throws Error{io} with HDF5's message. `path`: name of the store.
[[noreturn]] void fail_writing(const std::filesystem::path& path, const std::string& what);

/// An open file, not owned. Nothing in it has a timestamp, because then the bytes of every run
/// would differ. All functions throw Error{io}. Thread-safety: one thread at a time.
class WrittenFile {
  public:
    /// `path`: name of the store for messages; must outlive this object.
    WrittenFile(hid_t file, const std::filesystem::path& path) : file_(file), path_(&path) {}

    [[nodiscard]] hid_t get() const { return file_; }
    [[nodiscard]] const std::filesystem::path& path() const { return *path_; }
    GroupHandle create_group(const std::string& name) const;
    /// Creates a contiguous dataset.
    DatasetHandle create_whole(const std::string& name, hid_t type,
                               std::span<const hsize_t> dims) const;
    DatasetHandle write_whole(const std::string& name, hid_t type, std::span<const hsize_t> dims,
                              const void* numbers) const;
    /// Writes `count` numbers starting at `at` of a dataset of this file. `name`: for error
    /// messages.
    void write_part(const DatasetHandle& dataset, const std::string& name, hid_t type,
                    std::span<const hsize_t> at, std::span<const hsize_t> count,
                    const void* numbers) const;
    /// Closes the dataset. HDF5 buffers small writes until then, so only this call reports whether
    /// the disk accepted them. `name`: for error messages.
    void close(DatasetHandle dataset, const std::string& name) const;

  private:
    hid_t file_;
    const std::filesystem::path* path_;
};

// Writes names and colours of labels: FORMAT.md, section 3.

/// Throws Error{io}, and Error{invalid_argument} for invalid names.
void write_names_of_labels(const WrittenFile& file, std::span<const LabelName> names);

// Writes the ranges of cubes: FORMAT.md, "Ranges of cubes".

/// Writes the ranges of a level, [z][y][x], with the checksums of their planes. Throws Error{io}.
void write_ranges_of_cubes(const WrittenFile& file, const StoreLayout& layout, int level,
                           std::span<const CubeRange> ranges);

}  // namespace isonest::detail
