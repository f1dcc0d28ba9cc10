#include "tools/python/src/reports.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include <isonest/extract.h>
#include <isonest/preprocess.h>

#include "tools/python/src/arrays.h"

namespace isonest::python {
namespace {

py::object value_of(const PreprocessReport& r, std::size_t which, double value) {
    return r.labels ? py::object(py::int_(r.labels->at(which))) : py::object(py::float_(value));
}

void add_preprocess_report(py::module_& module) {
    using R = PreprocessReport;
    py::class_<R>(module, "PreprocessReport", "What isonest.preprocess has done.")
        .def_property_readonly(
            "shape", [](const R& r) { return shape_of(r.nodes); }, "nodes per axis, (z, y, x)")
        .def_readonly("levels", &R::levels)
        .def_readonly("input_bytes", &R::input_bytes)
        .def_readonly("store_bytes", &R::store_bytes)
        .def_readonly("chunks", &R::chunks)
        .def_property_readonly(
            "min", [](const R& r) { return value_of(r, 0, r.min_value); },
            "the smallest finite value; of 64-bit labels an int")
        .def_property_readonly(
            "max", [](const R& r) { return value_of(r, 1, r.max_value); },
            "the largest finite value; of 64-bit labels an int")
        .def_readonly("has_missing", &R::has_missing, "values that are not finite were found")
        .def_readonly("resumed_chunks", &R::resumed_chunks, "taken over from an interrupted run")
        .def_readonly("input_on_disk", &R::input_on_disk,
                      "the input was first copied to temporary space: there was little memory")
        .def_readonly("seconds", &R::seconds)
        .def("__repr__", [](const R& r) {
            return py::str("PreprocessReport(shape={}, levels={}, store_bytes={}, seconds={:.3f})")
                .format(shape_of(r.nodes), r.levels, r.store_bytes, r.seconds);
        });
}

std::optional<std::string> analysis_of(const ExtractReport& r) {
    if (!r.analysis) {
        return std::nullopt;
    }
    switch (r.analysis->use) {
        case AnalysisUse::made:
            return "made";
        case AnalysisUse::found:
            return "found";
        case AnalysisUse::replaced_stale:
            return "replaced_stale";
        case AnalysisUse::replaced_damaged:
            return "replaced_damaged";
        case AnalysisUse::not_used:
            break;
    }
    return "not_used";
}

void add_extract_report(py::module_& module) {
    using R = ExtractReport;
    using Q = TriangleQuality;
    py::class_<Q>(module, "TriangleQuality", "The smallest angles of triangles, in degrees.")
        .def_readonly("least", &Q::least)
        .def_readonly("per_mille", &Q::per_mille)
        .def_readonly("percent", &Q::percent)
        .def_readonly("five_percent", &Q::five_percent)
        .def_readonly("median", &Q::median)
        .def_readonly("narrow_share", &Q::narrow_share, "share with an angle below 5 degrees");
    py::class_<R>(module, "Report", "How a mesh was made, and what is known of it.")
        .def_readonly("vertices", &R::vertices)
        .def_readonly("triangles", &R::triangles, "or lines, of data in a plane")
        .def_readonly("tolerance", &R::tolerance, "the error that was asked for")
        .def_readonly("error_bound", &R::error_bound,
                      "the error that is known of the mesh, not above the tolerance")
        .def_readonly("value_rounding", &R::value_rounding)
        .def_readonly("value_range", &R::value_range)
        .def_property_readonly(
            "indicator", [](const R& r) { return std::string(name_of(r.traversal.stop)); },
            "the field of the store that said where to stop")
        .def_property_readonly(
            "bound", [](const R& r) { return std::string(name_of(r.traversal.bound)); },
            "the field by which elements without surface were left out")
        .def_property_readonly(
            "culled_by",
            [](const R& r) {
                return r.traversal.culled_by
                           ? std::optional(std::string(name_of(*r.traversal.culled_by)))
                           : std::nullopt;
            },
            "the field by which what faces away was left out, or None")
        .def_property_readonly(
            "distance",
            [](const R& r) { return r.distance ? std::optional(r.distance->asked) : std::nullopt; },
            "the distance within which the mesh was to be, in world units, or None")
        .def_property_readonly(
            "distance_bound", [](const R& r) { return r.distance ? r.distance->bound : 0.0; },
            "what is proven of it, not above the distance")
        .def_readonly("within_budget", &R::within_budget,
                      "whether there are no more triangles than were asked for, or None")
        .def_property_readonly(
            "full_triangles",
            [](const R& r) { return r.distance ? r.distance->full_triangles : 0; },
            "of the surface at full resolution, if a distance was asked for")
        .def_property_readonly(
            "full_area",
            [](const R& r) {
                return r.distance && r.distance->full ? std::optional(r.distance->full->area)
                                                      : std::nullopt;
            },
            "of the surface that the distance is from, in square world units, or None")
        .def_property_readonly(
            "full_volume",
            [](const R& r) {
                return r.distance && r.distance->full ? r.distance->full->volume : std::nullopt;
            },
            "within that surface, in cubic world units; None unless it is closed")
        .def_property_readonly(
            "full_volume_interval",
            [](const R& r) {
                return r.volume_interval ? std::optional(std::pair(r.volume_interval->least,
                                                                   r.volume_interval->most))
                                         : std::nullopt;
            },
            "between which volumes that at full resolution lies, if it was asked for, or None")
        .def_property_readonly(
            "smooth_passes",
            [](const R& r) { return r.smooth ? std::optional(r.smooth->passes) : std::nullopt; },
            "how often the vertices of a smooth label were moved, or None")
        .def_property_readonly(
            "smooth_bound", [](const R& r) { return r.smooth ? r.smooth->bound : 0.0; },
            "proven: no point of a smooth label's mesh is further from the faces of its voxels, in "
            "world units")
        .def_property_readonly(
            "nodes_beyond", [](const R& r) { return r.smooth ? r.smooth->nodes_beyond : 0.0; },
            "proven: all nodes further than this from the surfaces between smooth labels are "
            "inside "
            "the meshes of their own labels alone, in world units; 0: all nodes")
        .def_property_readonly(
            "neighbours",
            [](const R& r) {
                std::map<std::int64_t, double> areas;
                if (r.smooth) {
                    for (const NeighbourLabel& n : r.smooth->neighbours) {
                        areas.emplace(n.id, n.area);
                    }
                }
                return areas;
            },
            "of a smooth label: the labels that it touches, and the area that their meshes share, "
            "in square world units")
        .def_property_readonly(
            "outside",
            [](const R& r) {
                return r.interfaces ? std::optional(r.interfaces->outside) : std::nullopt;
            },
            "of interfaces: the number in place of a label for what has none, or None")
        .def_property_readonly("nested_triangles",
                               [](const R& r) {
                                   return r.simplified_error ? r.simplified_error->nested_triangles
                                                             : 0;
                               })
        .def_property_readonly(
            "components", [](const R& r) { return r.components ? r.components->components : 0; })
        .def_property_readonly("dropped_components",
                               [](const R& r) { return r.components ? r.components->dropped : 0; })
        .def_property_readonly(
            "dropped_triangles",
            [](const R& r) { return r.components ? r.components->dropped_triangles : 0; })
        .def_property_readonly(
            "largest_dropped",
            [](const R& r) { return r.components ? r.components->largest_dropped : 0; },
            "triangles of the largest of them")
        .def_property_readonly(
            "border_vertices",
            [](const R& r) { return r.closing ? r.closing->border_vertices : 0; })
        .def_property_readonly(
            "analysis", [](const R& r) { return analysis_of(r); },
            "what was done with a kept analysis: 'made', 'found', 'replaced_stale', "
            "'replaced_damaged' or 'not_used'; None if none was asked for")
        .def_property_readonly(
            "analysis_file",
            [](const R& r) { return r.analysis ? std::optional(r.analysis->file) : std::nullopt; },
            "where it is kept, or None")
        .def_property_readonly("mended_triangles", [](const R& r) { return r.mending.mended; })
        .def_property_readonly("zero_area_triangles",
                               [](const R& r) { return r.mending.zero_area; })
        .def_property_readonly(
            "apart_vertices", [](const R& r) { return r.apart.moved; },
            "vertices of sheets that touch, moved so that no two are in one place")
        .def_property_readonly(
            "together_vertices", [](const R& r) { return r.apart.together; },
            "vertices that are in one place all the same")
        .def_readonly(
            "coordinate_rounding", &R::coordinate_rounding,
            "most by which float32 coordinates are off, in distances of neighbouring nodes")
        .def_property_readonly("visited_cells", [](const R& r) { return r.traversal.visited; })
        .def_property_readonly("leaf_cells", [](const R& r) { return r.traversal.leaves; })
        .def_property_readonly("chunks_read", [](const R& r) { return r.traversal.chunks_read; })
        .def_property_readonly("chunks_total", [](const R& r) { return r.traversal.chunks_total; })
        .def_property_readonly("bytes_read", [](const R& r) { return r.traversal.bytes_read; })
        .def_property_readonly(
            "area",
            [](const R& r) { return r.measures ? std::optional(r.measures->area) : std::nullopt; },
            "of the mesh, in square world units; None of lines")
        .def_property_readonly(
            "volume", [](const R& r) { return r.measures ? r.measures->volume : std::nullopt; },
            "within the mesh, in cubic world units; None unless it is closed")
        .def_readonly("quality", &R::quality, "TriangleQuality if it was asked for, or None")
        .def_readonly("seconds", &R::seconds)
        .def("__repr__", [](const R& r) {
            return py::str("Report(vertices={}, triangles={}, error_bound={}, seconds={:.3f})")
                .format(r.vertices, r.triangles, r.error_bound, r.seconds);
        });
}

}  // namespace

void add_reports(py::module_& module) {
    add_preprocess_report(module);
    add_extract_report(module);
}

}  // namespace isonest::python
