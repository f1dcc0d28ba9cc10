#include "tools/python/src/queries.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "tools/python/src/arrays.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/stores.h"

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

Cells cells_of(const std::string& name) {
    return choose("cells", name,
                  std::array<std::pair<const char*, Cells>, 2>{
                      {{"tetrahedra", Cells::tetrahedra}, {"hexahedra", Cells::hexahedra}}});
}

std::optional<Outside> outside_of(const std::optional<std::string>& name) {
    if (!name) {
        return std::nullopt;
    }
    return choose("close", *name,
                  std::array<std::pair<const char*, Outside>, 2>{
                      {{"below", Outside::below}, {"above", Outside::above}}});
}

Field field_of_name(const std::string& name) {
    const std::optional<Field> field = field_from_name(name);
    if (!field) {
        throw Error(ErrorKind::invalid_argument, "there is no indicator '" + name + "'",
                    {{RemedyKind::other_field, list_names(all_fields())}});
    }
    return *field;
}

/// A query, and the stores that it names.
template <class Query>
struct Asked {
    Query query;
    std::shared_ptr<const Store> values;
    std::optional<LabelChoice> label = {};  ///< in place of an isovalue

    void set_values(const OpenStore& store) {
        values = store.get();
        query.attributes.values = values.get();
    }
};
using AskedSurface = Asked<SurfaceQuery>;
using AskedSlice = Asked<SliceQuery>;

template <class T>
py::object array_or_none(std::vector<T>&& rows) {
    return rows.empty() ? py::object(py::none()) : py::object(as_array(std::move(rows)));
}

ExtractReport extract_asked(const Store& store, const AskedSlice& asked, MeshSink& mesh,
                            const ExtractOptions& options, Progress& progress) {
    return extract(store, asked.query, mesh, options, progress);
}
ExtractReport extract_asked(const Store& store, const AskedSurface& asked, MeshSink& mesh,
                            const ExtractOptions& options, Progress& progress) {
    return asked.label
               ? extract(store, label_query(asked.query, *asked.label), mesh, options, progress)
               : extract(store, asked.query, mesh, options, progress);
}

/// (positions, elements, normals, values, errors, report): the arrays own the mesh.
template <class Query>
py::tuple extract_mesh(const OpenStore& handle, const Asked<Query>& asked,
                       const ExtractOptions& options, const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    MeshCollector mesh;
    ExtractReport report;
    run_watched(progress,
                [&](Progress& p) { report = extract_asked(*store, asked, mesh, options, p); });
    py::array elements = report.dimension == 2 && mesh.triangles.empty()
                             ? as_array(std::move(mesh.lines))
                             : as_array(std::move(mesh.triangles));
    return py::make_tuple(as_array(std::move(mesh.positions)), std::move(elements),
                          array_or_none(std::move(mesh.normals)),
                          array_or_none(std::move(mesh.values)),
                          array_or_none(std::move(mesh.errors)), std::move(report));
}

Cells& cells(SurfaceQuery& query) {
    return query.grid.cells;
}
Cells& cells(SliceQuery& query) {
    return query.cells;
}

/// What surfaces and slices have in common.
template <class Query>
void add_common(py::class_<Asked<Query>>& type) {
    using namespace py::literals;
    using A = Asked<Query>;
    type.def(py::init<>())
        .def(
            "set_error",
            [](A& a, double value, bool relative, const std::string& guarantee) {
                a.query.stop = ErrorBound{value, relative, guarantee_of(guarantee)};
            },
            "value"_a, "relative"_a, "guarantee"_a)
        .def(
            "set_box",
            [](A& a, const Double3& lo, const Double3& hi) {
                a.query.box = WorldBox{lo, hi};
            },
            "lo"_a, "hi"_a)
        .def("set_values", &A::set_values, "store"_a)
        .def("set_cells", [](A& a, const std::string& name) { cells(a.query) = cells_of(name); })
        .def("set_vertex_error",
             [](A& a, const std::string& name) { a.query.attributes.error = field_of_name(name); })
        .def_property(
            "normals", [](const A& a) { return a.query.attributes.normals; },
            [](A& a, bool normals) { a.query.attributes.normals = normals; });
}

void add_surface(py::module_& module) {
    using namespace py::literals;
    py::class_<AskedSurface> type(module, "SurfaceQuery");
    add_common(type);
    type.def_property(
            "level", [](const AskedSurface& a) { return a.query.iso; },
            [](AskedSurface& a, double level) { a.query.iso = level; })
        .def(
            "set_simplified_error",
            [](AskedSurface& a, double value, bool relative, const std::string& guarantee) {
                a.query.stop = SimplifiedErrorBound{{value, relative, guarantee_of(guarantee)}};
            },
            "value"_a, "relative"_a, "guarantee"_a)
        .def(
            "set_distance",
            [](AskedSurface& a, double value, bool voxels) {
                a.query.stop = DistanceBound{value, voxels};
            },
            "value"_a, "voxels"_a)
        .def(
            "set_triangles",
            [](AskedSurface& a, std::uint64_t most, std::optional<double> within, bool voxels) {
                TriangleBudget budget{most};
                if (within) {
                    budget.within = DistanceBound{*within, voxels};
                }
                a.query.stop = budget;
            },
            "most"_a, "within"_a, "voxels"_a)
        .def("set_exact_vertices",
             [](AskedSurface& a) { a.query.grid.vertices = VertexPlace::exact; })
        .def("set_close",
             [](AskedSurface& a, const std::optional<std::string>& outside) {
                 a.query.stages.close = outside_of(outside);
             })
        .def(
            "set_label", [](AskedSurface& a, std::int64_t id) { a.label = LabelChoice{id}; },
            "id"_a)
        .def(
            "set_components",
            [](AskedSurface& a, std::uint64_t largest, std::uint64_t least_triangles,
               double least_volume) {
                a.query.stages.components = ComponentChoice{largest, least_triangles, least_volume};
            },
            "largest"_a, "least_triangles"_a, "least_volume"_a);
}

void add_slice(py::module_& module) {
    using namespace py::literals;
    py::class_<AskedSlice> type(module, "SliceQuery");
    add_common(type);
    type.def(
        "set_plane",
        [](AskedSlice& a, const Double3& normal, double offset) {
            a.query.plane = {normal, offset};
        },
        "normal"_a, "offset"_a);
}

}  // namespace

void add_queries(py::module_& module) {
    using namespace py::literals;
    add_surface(module);
    add_slice(module);
    py::class_<ExtractOptions>(module, "ExtractOptions")
        .def(py::init<>())
        .def_readwrite("memory", &ExtractOptions::memory)
        .def_readwrite("threads", &ExtractOptions::threads)
        .def_readwrite("scratch", &ExtractOptions::scratch)
        .def_readwrite("quality", &ExtractOptions::quality);
    module.def("extract", &extract_mesh<SurfaceQuery>, "store"_a, "query"_a, "options"_a,
               "progress"_a);
    module.def("extract", &extract_mesh<SliceQuery>, "store"_a, "query"_a, "options"_a,
               "progress"_a);
}

}  // namespace isonest::python
