// What preprocessing and extraction report.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Adds PreprocessReport and ExtractReport, with attributes that can only be read.
void add_reports(py::module_& module);

}  // namespace isonest::python
