// Reports of preprocessing and extraction, and exceptions.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// Translates isonest::Error to the exceptions of isonest._errors, and std::filesystem errors to
/// OSError.
void translate_errors();

/// Adds PreprocessReport, Report and TriangleQuality, whose attributes are read-only.
void add_reports(py::module_& module);

}  // namespace isonest::python
