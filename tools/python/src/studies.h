// A store's fields: written as volume files, and compared.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds export_field(), study() and StudyRow. REQUIRES: add_stores() was called.
void add_studies(py::module_& module);

}  // namespace isonest::python
