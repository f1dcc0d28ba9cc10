// Volumes: files, NumPy arrays, and whatever gives NumPy arrays when it is sliced.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <utility>

#include <isonest/volume_source.h>

namespace isonest::python {

namespace py = pybind11;

/// A volume that is read once, by whoever takes it.
class Source {
  public:
    explicit Source(std::unique_ptr<VolumeSource> volume) : volume_(std::move(volume)) {}
    /// Throws py::value_error if it was taken before.
    [[nodiscard]] std::unique_ptr<VolumeSource> take();
    /// Throws py::value_error if it was taken.
    [[nodiscard]] VolumeSource& volume() const;

  private:
    std::unique_ptr<VolumeSource> volume_;
};

/// Adds Source, SourceOptions, source_of_files(), source_of_array(), source_of_reader() and
/// preprocess().
void add_sources(py::module_& module);

}  // namespace isonest::python
