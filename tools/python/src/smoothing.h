// Smoothing by nonlinear diffusion, exporting fields, and studies of indicators.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds export_field(), study() and StudyRow. REQUIRES: add_stores() was called.
void add_studies(py::module_& module);

/// Adds smooth(), SmoothOptions and SmoothStep. REQUIRES: add_stores() and add_sources() were
/// called.
void add_smoothing(py::module_& module);

}  // namespace isonest::python
