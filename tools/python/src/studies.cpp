#include "tools/python/src/studies.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "query/extract/export.h"
#include "query/study/export_computed.h"
#include "query/study/study.h"
#include "tools/python/src/fields.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/stores.h"

namespace isonest::python {
namespace {

using detail::StudyOptions;
using detail::StudyRow;

void export_store_field(const OpenStore& handle, const std::filesystem::path& path,
                        const std::string& field, int level, bool replace, std::uint64_t memory,
                        const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    run_watched(progress, [&](Progress& p) {
        if (const auto computed = detail::computed_field_from_name(field)) {
            detail::export_computed_field(store->reader(), path,
                                          {*computed, level, replace, memory}, p);
        } else {
            detail::export_field(store->reader(), path,
                                 {field_of_name(field), level, replace, memory}, p);
        }
    });
}

/// Those with these names; without names all of the store that can be studied so.
std::vector<detail::StudyField> study_fields(const Store& store, const StudyOptions& options,
                                             const std::optional<std::vector<std::string>>& names) {
    std::vector<detail::StudyField> fields;
    if (!names) {
        const detail::StoreLayout& layout = store.reader().layout();
        for (const Field field : layout.header().fields) {
            if (!is_of_cells(field) || suit_cells(layout, options)) {
                fields.emplace_back(field);
            }
        }
        return fields;
    }
    for (const std::string& name : *names) {
        if (const auto computed = detail::computed_field_from_name(name)) {
            fields.emplace_back(*computed);
        } else {
            fields.emplace_back(indicator_of_name(name));
        }
    }
    return fields;
}

/// (all elements, all cells, rows)
py::tuple study_store(const OpenStore& handle, const std::optional<std::vector<std::string>>& names,
                      StudyOptions options, const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    options.fields = study_fields(*store, options, names);
    detail::Study study;
    run_watched(progress, [&](Progress& p) { study = detail::study(store->reader(), options, p); });
    return py::make_tuple(study.all_elements, study.all_cells, std::move(study.rows));
}

void add_study_options(py::module_& module) {
    using namespace py::literals;
    using O = StudyOptions;
    py::class_<O>(module, "StudyOptions")
        .def(py::init<>())
        .def_readwrite("steps", &O::steps)
        .def_readwrite("least", &O::least)
        .def_readwrite("iso", &O::iso)
        .def_readwrite("norm", &O::power)
        .def_readwrite("graph_distance", &O::graphs)
        .def_readwrite("memory", &O::memory)
        .def_readwrite("threads", &O::threads)
        .def(
            "set_plane",
            [](O& o, const Double3& normal, double offset) {
                o.plane = WorldPlane{normal, offset};
            },
            "normal"_a, "offset"_a);
}

}  // namespace

void add_studies(py::module_& module) {
    using namespace py::literals;
    using R = StudyRow;
    module.def("export_field", &export_store_field, "store"_a, "path"_a, "field"_a, "level"_a,
               "replace"_a, "memory"_a, "progress"_a);
    add_study_options(module);
    py::class_<R>(module, "StudyRow",
                  "One threshold of one field: the mesh that is refined where the field is not "
                  "below it.")
        .def_property_readonly("field", [](const R& r) { return name_of(r.field); })
        .def_readonly("threshold", &R::threshold, "of the field's largest value")
        .def_readonly("visited", &R::visited, "cells of all levels")
        .def_readonly("leaves", &R::leaves, "elements of the mesh")
        .def_readonly("nodes", &R::nodes, "of the mesh")
        .def_property_readonly(
            "l1", [](const R& r) { return r.norms.l1; },
            "the error of the function on the mesh, of the data's range, in three norms")
        .def_property_readonly("l2", [](const R& r) { return r.norms.l2; })
        .def_property_readonly("linf", [](const R& r) { return r.norms.linf; })
        .def_property_readonly(
            "value_lp", [](const R& r) { return r.true_norms.value; },
            "with norm=: the errors in that norm, integrated")
        .def_property_readonly("gradient_lp", [](const R& r) { return r.true_norms.gradient; })
        .def_property_readonly("gradient_linf",
                               [](const R& r) { return r.true_norms.gradient_linf; })
        .def_readonly("graph_distance", &R::graph_distance, "with graph_distance=True")
        .def_readonly("iso_visited", &R::iso_visited, "with iso=: what extracting it visits")
        .def_readonly("iso_leaves", &R::iso_leaves)
        .def("__repr__", [](const R& r) {
            return py::str("StudyRow({} at {:.3g}: leaves={}, linf={:.3g})")
                .format(name_of(r.field), r.threshold, r.leaves, r.norms.linf);
        });
    module.def("study", &study_store, "store"_a, "fields"_a, "options"_a, "progress"_a);
}

}  // namespace isonest::python
