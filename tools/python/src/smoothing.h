// Volumes smoothed by nonlinear diffusion.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds smooth(), SmoothOptions and SmoothStep. REQUIRES: add_stores() and add_sources() were
/// called.
void add_smoothing(py::module_& module);

}  // namespace isonest::python
