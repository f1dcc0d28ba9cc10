// Surfaces and slices of a store.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds SurfaceQuery, SliceQuery, ExtractOptions and extract(). Everything is in world coordinates,
/// x, y, z. REQUIRES: add_stores() and add_reports() were called.
void add_queries(py::module_& module);

}  // namespace isonest::python
