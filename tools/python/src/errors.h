// The library's errors as Python exceptions.
#pragma once

#include <pybind11/pybind11.h>

namespace isonest::python {

namespace py = pybind11;

/// isonest::Error becomes an exception of isonest._errors, a failure of the file system an OSError.
void translate_errors();

}  // namespace isonest::python
