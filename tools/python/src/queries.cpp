#include "tools/python/src/queries.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

namespace isonest::python {
namespace {

/// Warns if the name was renamed. REQUIRES: the global interpreter lock is held. Throws
/// py::error_already_set if warnings are errors.
void warn_of_renamed(const std::string& name) {
    const std::string note = note_on_name(name);
    if (!note.empty() && PyErr_WarnEx(PyExc_FutureWarning, note.c_str(), 2) != 0) {
        throw py::error_already_set();
    }
}

}  // namespace

Field field_of_name(const std::string& name) {
    warn_of_renamed(name);
    const std::optional<Field> field = field_from_name(name);
    if (!field) {
        throw Error(ErrorKind::invalid_argument, "there is no field '" + name + "'",
                    {{RemedyKind::other_field, "values, " + list_names(all_fields())}});
    }
    return *field;
}

Field indicator_of_name(const std::string& name) {
    warn_of_renamed(name);
    const std::optional<Field> field = field_from_name(name);
    if (!field || *field == Field::values) {
        throw Error(ErrorKind::invalid_argument, "there is no indicator '" + name + "'",
                    {{RemedyKind::other_field, list_names(all_fields())}});
    }
    return *field;
}

std::vector<Field> indicators_of_names(const std::vector<std::string>& names) {
    std::vector<Field> fields;
    for (const std::string& name : names) {
        warn_of_renamed(name);
        const std::vector<Field> named = indicators_from_name(name);
        if (named.empty()) {
            throw Error(ErrorKind::invalid_argument, "there is no indicator '" + name + "'",
                        {{RemedyKind::other_field, "nodes, all, " + list_names(all_fields())}});
        }
        fields.insert(fields.end(), named.begin(), named.end());
    }
    std::sort(fields.begin(), fields.end());
    fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    return fields;
}

LengthUnit unit_of_name(const std::string& name) {
    const std::optional<LengthUnit> unit = length_unit_from(name);
    if (!unit) {
        throw Error(ErrorKind::invalid_argument, "there is no unit of length '" + name +
                                                     "'; there are " + list_of_length_units());
    }
    return *unit;
}

namespace {

/// The value in `choices` with this name. Throws py::value_error; `what` is the argument's name.
template <class T, std::size_t n>
T choose(const char* what, const std::string& name,
         const std::array<std::pair<const char*, T>, n>& choices) {
    std::string names;
    for (const auto& [known, value] : choices) {
        if (name == known) {
            return value;
        }
        names += (names.empty() ? "'" : ", '") + std::string(known) + "'";
    }
    throw py::value_error(std::string(what) + "='" + name + "': give one of " + names);
}

ErrorIndicator error_indicator(const std::string& name) {
    return choose("indicator", name,
                  std::array<std::pair<const char*, ErrorIndicator>, 3>{
                      {{"deviation", ErrorIndicator::deviation},
                       {"plus", ErrorIndicator::plus},
                       {"estimate", ErrorIndicator::estimate}}});
}

Effort effort_of(const std::string& name) {
    return choose("effort", name,
                  std::array<std::pair<const char*, Effort>, 3>{
                      {{"none", Effort::none}, {"fast", Effort::fast}, {"best", Effort::best}}});
}

/// The names used by the program, and the full names. `cubes`: the name of cells that are not
/// simplices.
Cells cells_of(const std::string& name, const char* cubes, const char* cubes_in_full) {
    return choose(
        "cells", name,
        std::array<std::pair<const char*, Cells>, 4>{{{"tet", Cells::tetrahedra},
                                                      {cubes, Cells::hexahedra},
                                                      {"tetrahedra", Cells::tetrahedra},
                                                      {cubes_in_full, Cells::hexahedra}}});
}

VertexPlace vertices_of(const std::string& name) {
    return choose("vertices", name,
                  std::array<std::pair<const char*, VertexPlace>, 2>{
                      {{"linear", VertexPlace::linear}, {"exact", VertexPlace::exact}}});
}

Outside outside_of(const std::string& name) {
    return choose("close", name,
                  std::array<std::pair<const char*, Outside>, 2>{
                      {{"below", Outside::below}, {"above", Outside::above}}});
}

std::optional<Cells>& cells_in(SurfaceQuery& query) {
    return query.grid.cells;
}
template <class Query>
auto& cells_in(Query& query) {
    return query.cells;
}

/// Adds the methods that all queries share.
template <class A>
void add_common(py::class_<A>& type) {
    using namespace py::literals;
    type.def(py::init<>())
        .def(
            "set_error",
            [](A& a, double value, bool relative, const std::string& indicator) {
                a.query.stop = ErrorBound{value, relative, error_indicator(indicator)};
            },
            "value"_a, "relative"_a, "indicator"_a)
        .def(
            "set_threshold",
            [](A& a, const std::string& field, double value, bool relative) {
                a.query.stop = FieldThreshold{indicator_of_name(field), value, relative};
            },
            "field"_a, "value"_a, "relative"_a)
        .def(
            "set_focus",
            [](A& a, const Double3& lo, const Double3& hi, double falloff) {
                a.query.focus = Focus{lo, hi, falloff};
            },
            "lo"_a, "hi"_a, "falloff"_a)
        .def(
            "set_camera",
            [](A& a, const Double3& position, double fov, int height, double pixels) {
                a.query.camera = Camera{position, fov, height, pixels};
            },
            "position"_a, "fov"_a, "height"_a, "pixels"_a)
        .def(
            "set_box",
            [](A& a, const Double3& lo, const Double3& hi) {
                a.query.box = WorldBox{lo, hi};
            },
            "lo"_a, "hi"_a);
}

/// Adds the methods for queries with triangles; contour lines lack them. `cubes`: see cells_of().
template <class A>
void add_attributes(py::class_<A>& type, const char* cubes, const char* cubes_in_full) {
    using namespace py::literals;
    type.def(
            "set_vertex_values", [](A& a, const OpenStore& store) { a.set_values(store); },
            "store"_a)
        .def(
            "set_cells",
            [cubes, cubes_in_full](A& a, const std::string& name) {
                cells_in(a.query) = cells_of(name, cubes, cubes_in_full);
            },
            "name"_a)
        .def(
            "set_vertex_error",
            [](A& a, const std::string& name) {
                a.query.attributes.error = indicator_of_name(name);
            },
            "field"_a)
        .def(
            "set_normals", [](A& a, bool normals) { a.query.attributes.normals = normals; },
            "normals"_a);
}

/// Adds the stops that replace an error.
void add_surface_stops(py::class_<AskedSurface>& type) {
    using namespace py::literals;
    using A = AskedSurface;
    type.def(
            "set_effort",
            [](A& a, const std::string& effort) { a.query.effort = effort_of(effort); }, "effort"_a)
        .def(
            "set_distance",
            [](A& a, double value, bool voxels) {
                a.query.stop = DistanceBound{value, voxels};
            },
            "value"_a, "voxels"_a)
        .def(
            "set_triangles",
            [](A& a, std::uint64_t most, std::optional<double> within, bool voxels) {
                TriangleBudgetByDistance budget{most, {}};
                if (within) {
                    budget.within = DistanceBound{*within, voxels};
                }
                a.query.stop = budget;
            },
            "most"_a, "within"_a, "voxels"_a)
        .def(
            "set_triangles_by_error",
            [](A& a, std::uint64_t most) { a.query.stop = TriangleBudgetByError{most}; }, "most"_a);
}

void add_surface(py::module_& module) {
    using namespace py::literals;
    using A = AskedSurface;
    py::class_<A> type(module, "SurfaceQuery");
    add_common(type);
    add_attributes(type, "hex", "hexahedra");
    add_surface_stops(type);
    type.def(
            "set_iso", [](A& a, double iso) { a.query.iso = iso; }, "iso"_a)
        .def(
            "set_label", [](A& a, std::int64_t id) { a.label = LabelChoice{id}; }, "id"_a)
        .def(
            "set_smooth",
            [](A& a, std::optional<int> passes, bool keep_nodes) {
                a.smooth = passes ? LabelSmoothing{*passes} : LabelSmoothing{};
                a.smooth->keep_nodes = keep_nodes;
            },
            "passes"_a, "keep_nodes"_a)
        .def(
            "set_vertices",
            [](A& a, const std::string& place) { a.query.grid.vertices = vertices_of(place); },
            "place"_a)
        .def(
            "set_close",
            [](A& a, const std::string& outside) { a.query.stages.close = outside_of(outside); },
            "outside"_a)
        .def(
            "set_manifold", [](A& a, bool asked) { a.query.stages.manifold = asked; }, "asked"_a)
        .def(
            "set_volume_interval", [](A& a, bool asked) { a.query.volume_interval = asked; },
            "asked"_a)
        .def(
            "set_components",
            [](A& a, std::uint64_t largest, std::uint64_t min_triangles, double min_volume) {
                a.query.stages.components = ComponentChoice{largest, min_triangles, min_volume};
            },
            "largest"_a, "min_triangles"_a, "min_volume"_a)
        .def(
            "set_bound",
            [](A& a, const std::string& field) { a.query.grid.bound = indicator_of_name(field); },
            "field"_a)
        .def(
            "set_view",
            [](A& a, const Double3& direction, const std::optional<std::string>& field) {
                a.query.grid.culling = BackfaceCulling{direction};
                if (field) {
                    a.query.grid.culling->field = indicator_of_name(*field);
                }
            },
            "direction"_a, "cull_by"_a)
        .def(
            "set_kept_analysis",
            [](A& a, const std::filesystem::path& folder) {
                a.query.analysis = KeptAnalysis{folder};
            },
            "folder"_a);
}

template <class Query>
void set_plane(Asked<Query>& a, const Double3& normal, double offset) {
    a.query.plane = {normal, offset};
}

void add_planes(py::module_& module) {
    using namespace py::literals;
    py::class_<AskedSlice> slice(module, "SliceQuery");
    add_common(slice);
    add_attributes(slice, "hex", "hexahedra");
    slice.def("set_plane", &set_plane<SliceQuery>, "normal"_a, "offset"_a);

    py::class_<AskedContours> contours(module, "ContourQuery");
    add_common(contours);
    contours.def("set_plane", &set_plane<ContourQuery>, "normal"_a, "offset"_a)
        .def(
            "set_values",
            [](AskedContours& a, std::vector<double> values) {
                a.query.values = std::move(values);
            },
            "values"_a);

    py::class_<AskedGraph> graph(module, "GraphQuery");
    add_common(graph);
    add_attributes(graph, "quad", "quadrilaterals");
    graph.def(
        "set_scale", [](AskedGraph& a, double scale) { a.query.scale = scale; }, "scale"_a);
}

}  // namespace

void add_queries(py::module_& module) {
    add_surface(module);
    add_planes(module);
    module.def(
        "fields_needed",
        [](const AskedSurface& asked) { return names_of(fields_needed(asked.query)); },
        py::arg("query"));
    py::class_<ExtractOptions>(module, "ExtractOptions")
        .def(py::init<>())
        .def_readwrite("memory", &ExtractOptions::memory)
        .def_readwrite("threads", &ExtractOptions::threads)
        .def_readwrite("scratch", &ExtractOptions::scratch)
        .def_readwrite("quality", &ExtractOptions::quality);
}

}  // namespace isonest::python
