// isonest._core: the compiled part of the package. Users call the package's Python functions.
#include <pybind11/pybind11.h>

#include <isonest/version.h>

#include "tools/python/src/meshes.h"
#include "tools/python/src/queries.h"
#include "tools/python/src/reports.h"
#include "tools/python/src/smoothing.h"
#include "tools/python/src/sources.h"
#include "tools/python/src/stores.h"

PYBIND11_MODULE(_core, module) {
    module.doc() = "The compiled part of isonest. Coordinates are those of the world: x, y, z.";
    module.attr("version") = ISONEST_VERSION;
    isonest::python::translate_errors();
    isonest::python::add_reports(module);
    isonest::python::add_sources(module);
    isonest::python::add_stores(module);
    isonest::python::add_queries(module);
    isonest::python::add_meshes(module);
    isonest::python::add_checks(module);
    isonest::python::add_studies(module);
    isonest::python::add_smoothing(module);
}
