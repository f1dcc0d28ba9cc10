// Volumes for preprocess(): files, NumPy arrays, and whatever gives NumPy arrays when it is sliced.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds Source, SourceOptions, source_of_files(), source_of_array(), source_of_reader() and
/// preprocess().
void add_sources(py::module_& module);

}  // namespace isonest::python
