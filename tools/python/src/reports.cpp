#include "tools/python/src/reports.h"

#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/preprocess.h>

#include "tools/python/src/sources.h"

namespace isonest::python {
namespace {

/// The text of a remedy in terms of this package's arguments; {} is replaced by its value.
std::string_view words_of(RemedyKind kind) {
    switch (kind) {
        case RemedyKind::replace_existing:
            return "give replace=True to replace it";
        case RemedyKind::choose_dataset:
            return "choose one with dataset=";
        case RemedyKind::describe_numbers:
            return "for raw numbers give shape= and dtype=";
        case RemedyKind::place_in_world:
            return "give another {}";
        case RemedyKind::more_memory:
            return "give memory={} or more";
        case RemedyKind::smaller_chunk:
            return "give a smaller chunk=";
        case RemedyKind::fewer_threads:
            return "give threads={}";
        case RemedyKind::resume:
            return "call it again with resume=True to continue";
        case RemedyKind::no_resume:
            return "leave out resume=True";
        case RemedyKind::make_fields:
            return "preprocess the volume again with indicators={}";
        case RemedyKind::other_field:
            return "name another field: {}";
        case RemedyKind::larger_error:
            return "allow a larger error=";
        case RemedyKind::smaller_box:
            return "extract a part of it with box=";
        case RemedyKind::other_format:
            return "use {}";
        case RemedyKind::state_missing:
            return "give the same missing= as for preprocess";
        case RemedyKind::newer_version:
            return "use a newer isonest";
        case RemedyKind::correct_numbers:
            return "check {}";
        case RemedyKind::leave_out:
            return "leave out {}";
        case RemedyKind::other_name:
            return "give another name";
        case RemedyKind::free_space:
            return "free some space or choose another folder";
        case RemedyKind::good_copy:
            return "restore the file from a good copy";
        case RemedyKind::make_store:
            return "make a store with isonest.preprocess";
        case RemedyKind::preprocess_again:
            return "preprocess the volume again";
        case RemedyKind::smaller_input_chunk:
            return "store the input in smaller chunks";
        case RemedyKind::raise_limit:
            return "raise the limit ({})";
        case RemedyKind::same_options:
            return "give those";
        case RemedyKind::remove_leftover:
            return "delete it";
        case RemedyKind::smaller_picture:
            return "draw a smaller picture";
        case RemedyKind::less_memory:
            return "give less memory=";
        case RemedyKind::other_scale:
            return "give another scale";
        case RemedyKind::scale_values:
            return "scale the data or subtract an offset first";
        case RemedyKind::graph:
            return "draw its graph with Store.graph";
        case RemedyKind::choose_index:
            return "choose with index={{{}}}";
        case RemedyKind::choose_series:
            return "choose one with series=";
        case RemedyKind::install_package:
            return "install {} and build isonest again";
        case RemedyKind::say_unit:
            return "give unit='{}' with the volume, to isonest.preprocess or isonest.isosurface";
        case RemedyKind::world_units:
            return "give a plain number";
        case RemedyKind::fewer_components:
            return "give min_component={}";
        case RemedyKind::check_url:
            return "check the URL";
        case RemedyKind::give_credentials:
            return "give credentials in {} or with headers=";
        case RemedyKind::set_variable:
            return "set {} in the environment";
        case RemedyKind::serve_ranges:
            return "use a server with range requests (nginx, Apache, S3), or copy it to this "
                   "machine";
        case RemedyKind::try_later:
            return "try again later";
        case RemedyKind::open_again:
            return "open it again";
        case RemedyKind::download:
            return "download it first";
    }
    return "";
}

/// Translates names of members of SourceOptions to arguments of this package.
std::string in_our_names(const std::string& members) {
    std::string text;
    for (std::size_t at = 0; at < members.size();) {
        const std::size_t end = std::min(members.find(',', at), members.size());
        std::string name = members.substr(at, end - at);
        if (name == "dims") {
            name = "shape";
        } else if (name == "type" || name == "big_endian") {
            name = "dtype";
        }
        text += (text.empty() ? "" : " and ") + name + "=";
        at = end + 1;
    }
    return text;
}

/// "t=0,c=:" as entries of a dict: "'t': 0, 'c': None".
std::string entries_of_dict(const std::string& index) {
    std::string text;
    for (std::size_t at = 0; at < index.size();) {
        const std::size_t end = std::min(index.find(',', at), index.size());
        const std::string entry = index.substr(at, end - at);
        const std::size_t sign = entry.rfind('=');
        const std::string position = sign < entry.size() ? entry.substr(sign + 1) : "0";
        text += fmt::format("{}'{}': {}", text.empty() ? "" : ", ", entry.substr(0, sign),
                            position == ":" ? "None" : position);
        at = end + 1;
    }
    return text;
}

std::string text_of(const Remedy& remedy) {
    if (remedy.kind == RemedyKind::choose_index && remedy.value.empty()) {
        return "choose with index=, an entry per axis (5, None, None, None) or by name or number "
               "{'time': 5}";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::other_field) {
        return "name another field";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::more_memory) {
        return "give more memory=";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::fewer_components) {
        return "drop the smaller ones with min_component= or components='largest'";
    }
    const bool names_options = remedy.kind == RemedyKind::leave_out ||
                               remedy.kind == RemedyKind::correct_numbers ||
                               remedy.kind == RemedyKind::place_in_world;
    return fmt::format(fmt::runtime(words_of(remedy.kind)),
                       names_options                             ? in_our_names(remedy.value)
                       : remedy.kind == RemedyKind::choose_index ? entries_of_dict(remedy.value)
                                                                 : remedy.value);
}

bool is_about_memory(const Error& error) {
    return std::any_of(error.remedies().begin(), error.remedies().end(), [](const Remedy& r) {
        return r.kind == RemedyKind::more_memory || r.kind == RemedyKind::less_memory;
    });
}

const char* class_of(const Error& error) {
    switch (error.kind()) {
        case ErrorKind::invalid_argument:
            return "InvalidArgumentError";
        case ErrorKind::not_found:
            return "NotFoundError";
        case ErrorKind::corrupt:
            return "CorruptError";
        case ErrorKind::unsupported:
            return "UnsupportedError";
        case ErrorKind::io:
            return "InputOutputError";
        case ErrorKind::limit:
            return is_about_memory(error) ? "MemoryLimitError" : "LimitError";
        case ErrorKind::cancelled:
            return "CancelledError";
    }
    return "Error";
}

void raise(const Error& error) {
    py::list remedies;
    std::string message = error.what();
    const char* between = message.find('\n') == std::string::npos ? "; " : "\n";
    for (const Remedy& remedy : error.remedies()) {
        const std::string text = text_of(remedy);
        if (!text.empty()) {
            message += between + text;
            between = ", or ";
            remedies.append(text);
        }
    }
    const py::object type = py::module_::import("isonest._errors").attr(class_of(error));
    const py::object exception = type(message);
    exception.attr("file") = error.place().file;
    exception.attr("inside") = error.place().inside;
    exception.attr("problem") = error.problem();
    exception.attr("remedies") = py::tuple(remedies);
    PyErr_SetObject(type.ptr(), exception.ptr());
}

}  // namespace

void translate_errors() {
    // NOLINTNEXTLINE(performance-unnecessary-value-param): pybind11's signature
    py::register_exception_translator([](std::exception_ptr failure) {
        try {
            if (failure) {
                std::rethrow_exception(failure);
            }
        } catch (const Error& error) {
            raise(error);
        } catch (const std::filesystem::filesystem_error& error) {
            raise(Error(ErrorKind::io, {error.path1().string()}, error.code().message()));
        }
    });
}

namespace {

py::object value_of(const PreprocessReport& r, std::size_t which, double value) {
    return r.labels ? py::object(py::int_(r.labels->at(which))) : py::object(py::float_(value));
}

void add_preprocess_report(py::module_& module) {
    using R = PreprocessReport;
    py::class_<R>(module, "PreprocessReport", "The report of isonest.preprocess.")
        .def_property_readonly(
            "shape", [](const R& r) { return shape_of(r.nodes); }, "nodes per axis, (z, y, x)")
        .def_readonly("levels", &R::levels)
        .def_readonly("input_bytes", &R::input_bytes)
        .def_readonly("store_bytes", &R::store_bytes)
        .def_readonly("chunks", &R::chunks)
        .def_property_readonly(
            "min", [](const R& r) { return value_of(r, 0, r.min_value); },
            "the smallest finite value; an int for 64-bit labels")
        .def_property_readonly(
            "max", [](const R& r) { return value_of(r, 1, r.max_value); },
            "the largest finite value; an int for 64-bit labels")
        .def_readonly("has_missing", &R::has_missing, "values that are not finite were found")
        .def_readonly("resumed_chunks", &R::resumed_chunks, "reused from an interrupted run")
        .def_readonly("input_on_disk", &R::input_on_disk,
                      "the input was first copied to temporary space, for lack of memory")
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
    return name_of(r.analysis->use);
}

void add_extract_report(py::module_& module) {
    using R = ExtractReport;
    using Q = TriangleQuality;
    py::class_<Q>(module, "TriangleQuality",
                  "Distribution of the smallest angles of the triangles, in degrees.")
        .def(py::init<>())
        .def_readonly("least", &Q::least)
        .def_readonly("per_mille", &Q::per_mille)
        .def_readonly("percent", &Q::percent)
        .def_readonly("five_percent", &Q::five_percent)
        .def_readonly("median", &Q::median)
        .def_readonly("narrow_share", &Q::narrow_share,
                      "share of triangles with an angle below 5 degrees");
    py::class_<R>(module, "Report",
                  "The report of an extraction: how the mesh was made, and its properties.")
        .def(py::init<>())
        .def_readonly("vertices", &R::vertices)
        .def_readonly("triangles", &R::triangles,
                      "number of triangles; for isolines and contours, of lines")
        .def_readonly("tolerance", &R::tolerance, "the requested error")
        .def_readonly("data_tolerance", &R::data_tolerance,
                      "The largest amount by which the store's values were rounded; error_bound "
                      "includes it, distances are from the surface of the rounded values.")
        .def_readonly("error_bound", &R::error_bound,
                      "the proven error of the mesh, at most the tolerance")
        .def_readonly("value_rounding", &R::value_rounding)
        .def_readonly("value_range", &R::value_range)
        .def_property_readonly(
            "indicator", [](const R& r) { return std::string(name_of(r.traversal.stop)); },
            "the field of the stop test")
        .def_property_readonly(
            "bound", [](const R& r) { return std::string(name_of(r.traversal.bound)); },
            "the field used to skip elements without surface")
        .def_property_readonly(
            "culled_by",
            [](const R& r) {
                return r.traversal.culled_by
                           ? std::optional(std::string(name_of(*r.traversal.culled_by)))
                           : std::nullopt;
            },
            "the field used to leave out parts that face away, or None")
        .def_property_readonly(
            "distance",
            [](const R& r) { return r.distance ? std::optional(r.distance->asked) : std::nullopt; },
            "the requested distance to the full-resolution surface, in world units, or None")
        .def_property_readonly(
            "distance_bound", [](const R& r) { return r.distance ? r.distance->bound : 0.0; },
            "the proven distance, at most the requested one")
        .def_readonly(
            "within_budget", &R::within_budget,
            "whether there are at most as many triangles as requested; None without such a request")
        .def_property_readonly(
            "full_triangles",
            [](const R& r) { return r.distance ? r.distance->full_triangles : 0; },
            "number of triangles of the full-resolution surface, if a distance was requested")
        .def_property_readonly(
            "full_area",
            [](const R& r) {
                return r.distance && r.distance->full ? std::optional(r.distance->full->area)
                                                      : std::nullopt;
            },
            "area of the full-resolution surface, in square world units; None without a distance")
        .def_property_readonly(
            "full_volume",
            [](const R& r) {
                return r.distance && r.distance->full ? r.distance->full->volume : std::nullopt;
            },
            "volume enclosed by the full-resolution surface, in cubic world units; None unless it "
            "is closed")
        .def_property_readonly(
            "full_volume_interval",
            [](const R& r) {
                return r.volume_interval ? std::optional(std::pair(r.volume_interval->least,
                                                                   r.volume_interval->most))
                                         : std::nullopt;
            },
            "interval that contains the solid's volume at full resolution, if requested, or None")
        .def_property_readonly(
            "smooth_passes",
            [](const R& r) { return r.smooth ? std::optional(r.smooth->passes) : std::nullopt; },
            "number of smoothing passes of a smooth label, or None")
        .def_property_readonly(
            "smooth_bound", [](const R& r) { return r.smooth ? r.smooth->bound : 0.0; },
            "largest proven distance between a smooth label's mesh and the faces of its voxels, in "
            "world units")
        .def_property_readonly(
            "nodes_beyond", [](const R& r) { return r.smooth ? r.smooth->nodes_beyond : 0.0; },
            "proven: all nodes further than this from the surfaces between smooth labels are "
            "inside the meshes of their own labels only, in world units; 0: all nodes")
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
            "the labels that a smooth label touches, each with the area that their meshes share, "
            "in square world units")
        .def_property_readonly(
            "outside",
            [](const R& r) {
                return r.interfaces ? std::optional(r.interfaces->outside) : std::nullopt;
            },
            "of interfaces: the number that means no label, or None")
        .def_property_readonly("nested_triangles",
                               [](const R& r) {
                                   return r.simplified_error ? r.simplified_error->nested_triangles
                                                             : 0;
                               })
        .def_property_readonly(
            "full_error_bound",
            [](const R& r) {
                return r.simplified_error ? r.simplified_error->full_bound : std::nullopt;
            },
            "for hexahedra simplified within an error: the largest difference between the "
            "trilinear function and the isovalue on triangles kept from the full-resolution "
            "surface; else None")
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
            "triangles of the largest dropped component")
        .def_property_readonly(
            "border_vertices",
            [](const R& r) { return r.closing ? r.closing->border_vertices : 0; })
        .def_property_readonly(
            "analysis", [](const R& r) { return analysis_of(r); },
            "how a kept analysis was used: 'made', 'found', 'replaced_stale', 'replaced_damaged' "
            "or 'not_used'; None if none was requested")
        .def_property_readonly(
            "analysis_file",
            [](const R& r) { return r.analysis ? std::optional(r.analysis->file) : std::nullopt; },
            "the file of the kept analysis, or None")
        .def_property_readonly(
            "nonmanifold_edges",
            [](const R& r) { return r.manifold ? std::optional(r.manifold->edges) : std::nullopt; },
            "edges with more than two triangles: where a label touches itself; None if they were "
            "not counted")
        .def_property_readonly(
            "nonmanifold_vertices",
            [](const R& r) {
                return r.manifold ? std::optional(r.manifold->vertices) : std::nullopt;
            },
            "vertices with several fans of triangles, or None")
        .def_property_readonly(
            "split_vertices", [](const R& r) { return r.manifold ? r.manifold->copies : 0; },
            "vertices added with manifold=True")
        .def_property_readonly("mended_triangles", [](const R& r) { return r.mending.mended; })
        .def_property_readonly("zero_area_triangles",
                               [](const R& r) { return r.mending.zero_area; })
        .def_property_readonly(
            "apart_vertices", [](const R& r) { return r.apart.moved; },
            "vertices of touching sheets that were moved apart")
        .def_property_readonly(
            "together_vertices", [](const R& r) { return r.apart.together; },
            "vertices that still coincide with others")
        .def_readonly(
            "coordinate_rounding", &R::coordinate_rounding,
            "largest rounding error of float32 coordinates, relative to the distance between nodes")
        .def_property_readonly("visited_cells", [](const R& r) { return r.traversal.visited; })
        .def_property_readonly("leaf_cells", [](const R& r) { return r.traversal.leaves; })
        .def_property_readonly("chunks_read", [](const R& r) { return r.traversal.chunks_read; })
        .def_property_readonly("chunks_total", [](const R& r) { return r.traversal.chunks_total; })
        .def_property_readonly("bytes_read", [](const R& r) { return r.traversal.bytes_read; })
        .def_property_readonly(
            "area",
            [](const R& r) { return r.measures ? std::optional(r.measures->area) : std::nullopt; },
            "area of the mesh, in square world units; None for lines")
        .def_property_readonly(
            "volume", [](const R& r) { return r.measures ? r.measures->volume : std::nullopt; },
            "volume enclosed by the mesh, in cubic world units; None unless it is closed")
        .def_readonly("quality", &R::quality, "TriangleQuality if requested, or None")
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
