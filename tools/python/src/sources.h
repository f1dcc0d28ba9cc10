// Volumes: files, NumPy arrays, and whatever gives NumPy arrays when it is sliced.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest::python {

// C++ memory as NumPy arrays, and the order of their axes.

namespace py = pybind11;

/// An array (n, k) that owns the vector's memory: nothing is copied.
template <class T, std::size_t k>
py::array as_array(std::vector<std::array<T, k>>&& rows) {
    auto owner = std::make_unique<std::vector<std::array<T, k>>>(std::move(rows));
    const auto count = static_cast<py::ssize_t>(owner->size());
    const T* const first = owner->empty() ? nullptr : owner->front().data();
    const py::capsule free(owner.get(), [](void* at) {
        delete static_cast<std::vector<std::array<T, k>>*>(at);  // NOLINT: what release() gave
    });
    owner.release();  // NOLINT: the capsule deletes it
    return py::array_t<T>({count, static_cast<py::ssize_t>(k)}, first, free);
}

/// The same of numbers, (n,).
template <class T>
py::array as_array(std::vector<T>&& numbers) {
    auto owner = std::make_unique<std::vector<T>>(std::move(numbers));
    const auto count = static_cast<py::ssize_t>(owner->size());
    const T* const first = owner->data();
    const py::capsule free(owner.get(), [](void* at) {
        delete static_cast<std::vector<T>*>(at);  // NOLINT: what release() gave
    });
    owner.release();  // NOLINT: the capsule deletes it
    return py::array_t<T>(std::vector<py::ssize_t>{count}, first, free);
}

/// Of native byte order.
py::dtype dtype_of(ValueType type);
/// Of NumPy's name ("uint8"). Throws py::type_error for what is none of the eight types.
ValueType value_type_of(const py::dtype& dtype);

/// (z, y, x) of a NumPy array's shape.
inline py::tuple shape_of(const Int3& nodes) {
    return py::make_tuple(nodes.z, nodes.y, nodes.x);
}

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
