// Indicators whose numbers come from a Python function or a volume.
#pragma once

#include <pybind11/pybind11.h>

#include <isonest/preprocess.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds the methods add_own_function and add_own_volume.
void add_own_indicators(py::class_<PreprocessOptions>& options);

}  // namespace isonest::python
