#include "tools/python/src/checks.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "query/check/check.h"
#include "query/extract/analysis/kept_analysis.h"
#include "query/extract/info.h"
#include "tools/python/src/arrays.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/sources.h"
#include "tools/python/src/stores.h"

namespace isonest::python {
namespace {

/// A kept analysis, without its open file.
struct Analysis {
    std::filesystem::path path;
    std::string state;
    std::optional<std::string> query;
    std::optional<std::string> problem;
    std::vector<std::pair<double, std::uint64_t>> steps;  ///< distance, triangles
};

Analysis analysis_of(const detail::FoundAnalysis& found) {
    Analysis analysis;
    analysis.path = found.path;
    analysis.state = found.state == detail::AnalysisState::stale     ? "stale"
                     : found.state == detail::AnalysisState::damaged ? "damaged"
                                                                     : "current";
    if (!found.problem.empty()) {
        analysis.problem = found.problem;
    }
    if (found.file) {
        analysis.query = detail::query_text(*found.file);
        for (const detail::AnalysisStep& step : found.file->steps()) {
            analysis.steps.emplace_back(step.bound, step.triangles);
        }
    }
    return analysis;
}

std::vector<Analysis> analyses_of(const Store& store, detail::AnalysisDepth depth) {
    std::vector<Analysis> analyses;
    for (const detail::FoundAnalysis& found : detail::all_analyses(store.reader(), depth)) {
        analyses.push_back(analysis_of(found));
    }
    return analyses;
}

std::vector<Analysis> analyses(const OpenStore& handle) {
    const std::shared_ptr<const Store> store = handle.get();
    const py::gil_scoped_release without;
    return analyses_of(*store, detail::AnalysisDepth::attributes);
}

struct Checked {
    detail::CheckReport report;
    std::vector<Analysis> analyses;

    [[nodiscard]] bool ok() const {
        bool ok = report.failures == 0;
        for (const Analysis& analysis : analyses) {
            ok = ok && analysis.state != "damaged";
        }
        return ok;
    }
};

/// `source`: None, or the volume that the store was made from.
Checked check_store(const OpenStore& handle, bool quick, bool deep, Source* source,
                    std::uint64_t memory, int threads, const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    const std::unique_ptr<VolumeSource> volume = source != nullptr ? source->take() : nullptr;
    detail::CheckOptions options;
    options.depth = quick  ? detail::CheckDepth::quick
                    : deep ? detail::CheckDepth::deep
                           : detail::CheckDepth::standard;
    options.source = volume.get();
    options.memory = memory;
    options.threads = threads;
    Checked checked;
    run_watched(progress, [&](Progress& p) {
        checked.report = detail::check(store->reader(), options, p);
        checked.analyses = analyses_of(*store, detail::AnalysisDepth::bytes);
    });
    return checked;
}

void add_reports_of_checks(py::module_& module) {
    using detail::Finding;
    py::class_<Finding>(module, "Finding", "One thing that is wrong with a store.")
        .def_readonly("test", &Finding::test, "which test found it, such as 'checksum'")
        .def_readonly("field", &Finding::field)
        .def_readonly("level", &Finding::level)
        .def_property_readonly(
            "chunk", [](const Finding& f) { return shape_of(f.chunk); }, "its place, (z, y, x)")
        .def_property_readonly(
            "node",
            [](const Finding& f) {
                return f.node.x < 0 ? py::object(py::none()) : py::object(shape_of(f.node));
            },
            "(z, y, x) on the finest lattice; None if it is the chunk as a whole")
        .def_readonly("message", &Finding::message)
        .def("__repr__", [](const Finding& f) {
            return py::str("Finding({}: level {}, {}: {})")
                .format(f.test, f.level, f.field, f.message);
        });
    py::class_<Analysis>(module, "Analysis", "A kept analysis of a surface; see keep_analysis=.")
        .def_readonly("path", &Analysis::path)
        .def_readonly("state", &Analysis::state,
                      "'current'; 'stale' or 'damaged' ones are made anew when they are used")
        .def_readonly("query", &Analysis::query, "what it is of, in words; None if it is damaged")
        .def_readonly("problem", &Analysis::problem, "why it is not current, or None")
        .def_readonly("steps", &Analysis::steps, "the distances and triangles of its meshes");
    py::class_<Checked>(module, "CheckReport", "What Store.check has found.")
        .def_property_readonly("ok", &Checked::ok, "nothing is wrong")
        .def_property_readonly(
            "chunks", [](const Checked& c) { return c.report.chunks; },
            "of which the checksums were compared")
        .def_property_readonly(
            "nodes", [](const Checked& c) { return c.report.nodes; },
            "values and indicators compared")
        .def_property_readonly(
            "cubes", [](const Checked& c) { return c.report.cubes; },
            "bounds checked by brute force")
        .def_property_readonly("failures", [](const Checked& c) { return c.report.failures; })
        .def_property_readonly(
            "findings", [](const Checked& c) { return c.report.findings; },
            "the first 100 failures")
        .def_readonly("analyses", &Checked::analyses)
        .def("__repr__", [](const Checked& c) {
            return py::str("CheckReport(ok={}, chunks={}, nodes={}, cubes={}, failures={})")
                .format(c.ok(), c.report.chunks, c.report.nodes, c.report.cubes, c.report.failures);
        });
}

}  // namespace

void add_checks(py::module_& module) {
    using namespace py::literals;
    using R = detail::ArrayReport;
    add_reports_of_checks(module);
    py::class_<R>(module, "StoredArray", "An array of a store.")
        .def_readonly("level", &R::level)
        .def_property_readonly("field", [](const R& r) { return std::string(name_of(r.field)); })
        .def_property_readonly(
            "shape", [](const R& r) { return shape_of(r.nodes); }, "nodes, (z, y, x)")
        .def_property_readonly(
            "chunk", [](const R& r) { return shape_of(r.chunk); }, "nodes of a chunk, (z, y, x)")
        .def_readonly("chunks", &R::chunks)
        .def_readonly("raw_bytes", &R::raw_bytes, "of the nodes themselves")
        .def_readonly("stored_bytes", &R::stored_bytes)
        .def_property_readonly("min",
                               [](const R& r) {
                                   return r.labels ? py::object(py::int_((*r.labels)[0]))
                                                   : py::object(py::float_(r.min));
                               })
        .def_property_readonly("max",
                               [](const R& r) {
                                   return r.labels ? py::object(py::int_((*r.labels)[1]))
                                                   : py::object(py::float_(r.max));
                               })
        .def_readonly("alias", &R::alias, "the same bytes as another field of the level");
    module.def(
        "stored_arrays",
        [](const OpenStore& store) { return detail::describe_arrays(store.get()->reader()); },
        "store"_a);
    module.def("analyses", &analyses, "store"_a);
    module.def("check", &check_store, "store"_a, "quick"_a, "deep"_a, "source"_a, "memory"_a,
               "threads"_a, "progress"_a);
}

}  // namespace isonest::python
