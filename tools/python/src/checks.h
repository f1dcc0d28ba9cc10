// What a store holds, and whether it is whole.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds check(), stored_arrays(), analyses() and what they return. REQUIRES: add_stores() and
/// add_sources() were called.
void add_checks(py::module_& module);

}  // namespace isonest::python
