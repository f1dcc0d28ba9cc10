#include "tools/python/src/queries.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "tools/python/src/fields.h"

namespace isonest::python {
namespace {

/// The member of `choices` that has this name; `what` is the argument's.
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

Guarantee guarantee_of(const std::string& name) {
    return choose(
        "guarantee", name,
        std::array<std::pair<const char*, Guarantee>, 3>{{{"deviation", Guarantee::deviation},
                                                          {"plus", Guarantee::plus},
                                                          {"estimate", Guarantee::estimate}}});
}

Effort effort_of(const std::string& name) {
    return choose("effort", name,
                  std::array<std::pair<const char*, Effort>, 2>{
                      {{"fast", Effort::fast}, {"best", Effort::best}}});
}

/// By the names of the program, or written out. `cubes`: what cells are that are not simplices.
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

/// What all queries have.
template <class A>
void add_common(py::class_<A>& type) {
    using namespace py::literals;
    type.def(py::init<>())
        .def(
            "set_error",
            [](A& a, double value, bool relative, const std::string& guarantee) {
                a.query.stop = ErrorBound{value, relative, guarantee_of(guarantee)};
            },
            "value"_a, "relative"_a, "guarantee"_a)
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

/// What triangles have, and contour lines have not. `cubes`: see cells_of().
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

/// In place of an error.
void add_surface_stops(py::class_<AskedSurface>& type) {
    using namespace py::literals;
    using A = AskedSurface;
    type.def(
            "set_simplified_error",
            [](A& a, double value, bool relative, const std::string& guarantee) {
                a.query.stop = SimplifiedErrorBound{{value, relative, guarantee_of(guarantee)}};
            },
            "value"_a, "relative"_a, "guarantee"_a)
        .def(
            "set_distance",
            [](A& a, double value, bool voxels, const std::string& effort) {
                a.query.stop = DistanceBound{value, voxels, effort_of(effort)};
            },
            "value"_a, "voxels"_a, "effort"_a)
        .def(
            "set_nested_distance",
            [](A& a, double value, bool voxels) {
                a.query.stop = NestedDistanceBound{{value, voxels}};
            },
            "value"_a, "voxels"_a)
        .def(
            "set_triangles",
            [](A& a, std::uint64_t most, std::optional<double> within, bool voxels,
               const std::string& effort) {
                TriangleBudget budget{most, {}, effort_of(effort)};
                if (within) {
                    budget.within = DistanceBound{*within, voxels};
                }
                a.query.stop = budget;
            },
            "most"_a, "within"_a, "voxels"_a, "effort"_a)
        .def(
            "set_triangles_by_error",
            [](A& a, std::uint64_t most, bool simplified) {
                a.query.stop = ErrorBudget{.most = most, .simplified = simplified};
            },
            "most"_a, "simplified"_a);
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
            "set_volume_interval", [](A& a, bool asked) { a.query.volume_interval = asked; },
            "asked"_a)
        .def(
            "set_components",
            [](A& a, std::uint64_t largest, std::uint64_t least_triangles, double least_volume) {
                a.query.stages.components = ComponentChoice{largest, least_triangles, least_volume};
            },
            "largest"_a, "least_triangles"_a, "least_volume"_a)
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
    py::class_<ExtractOptions>(module, "ExtractOptions")
        .def(py::init<>())
        .def_readwrite("memory", &ExtractOptions::memory)
        .def_readwrite("threads", &ExtractOptions::threads)
        .def_readwrite("scratch", &ExtractOptions::scratch)
        .def_readwrite("quality", &ExtractOptions::quality);
}

}  // namespace isonest::python
