// Meshes: from a store to arrays, and from arrays to files.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds extract(), extract_labels(), MeshLayout and save_mesh(). REQUIRES: add_queries(),
/// add_stores() and add_reports() were called.
void add_meshes(py::module_& module);

}  // namespace isonest::python
