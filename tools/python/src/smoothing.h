// Volumes smoothed by nonlinear diffusion.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

// A store's fields: written as volume files, and compared.

namespace py = pybind11;

/// Adds export_field(), study() and StudyRow. REQUIRES: add_stores() was called.
void add_studies(py::module_& module);

/// Adds smooth(), SmoothOptions and SmoothStep. REQUIRES: add_stores() and add_sources() were
/// called.
void add_smoothing(py::module_& module);

}  // namespace isonest::python
