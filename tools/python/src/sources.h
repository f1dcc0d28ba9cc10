// Input volumes: files, NumPy arrays, and objects that return NumPy arrays when sliced.
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

// C++ memory as NumPy arrays, and the order of axes.

namespace py = pybind11;

/// Returns an array (n, k) that takes ownership of the vector's memory; nothing is copied.
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

/// The same for numbers, as an array (n,).
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

/// The dtype in native byte order.
py::dtype dtype_of(ValueType type);
/// The type with NumPy's name ("uint8"). Throws py::type_error unless it is one of the eight types
/// of a store.
ValueType value_type_of(const py::dtype& dtype);

/// The shape (z, y, x) of a NumPy array.
inline py::tuple shape_of(const Int3& nodes) {
    return py::make_tuple(nodes.z, nodes.y, nodes.x);
}

/// A volume that is read only once, by the first function that takes it.
class Source {
  public:
    explicit Source(std::unique_ptr<VolumeSource> volume) : volume_(std::move(volume)) {}
    /// Throws py::value_error if the volume was already taken.
    [[nodiscard]] std::unique_ptr<VolumeSource> take();
    /// Throws py::value_error if the volume was taken.
    [[nodiscard]] VolumeSource& volume() const;

  private:
    std::unique_ptr<VolumeSource> volume_;
};

/// Adds Source, SourceOptions, source_of_files(), source_of_array(), source_of_reader() and
/// preprocess().
void add_sources(py::module_& module);

}  // namespace isonest::python
