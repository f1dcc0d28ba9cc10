// What preprocessing and extraction report.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

// The library's errors as Python exceptions.

namespace py = pybind11;

/// isonest::Error becomes an exception of isonest._errors, a failure of the file system an OSError.
void translate_errors();

/// Adds PreprocessReport and ExtractReport, with attributes that can only be read.
void add_reports(py::module_& module);

}  // namespace isonest::python
