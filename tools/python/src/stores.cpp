#include "tools/python/src/stores.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/check.h>
#include <isonest/histogram.h>
#include <isonest/labels.h>
#include <isonest/series.h>
#include <isonest/values.h>

#include "query/extract/extract.h"
#include "query/extract/kept_analysis.h"
#include "query/values/label_view.h"
#include "store/base/label_text.h"
#include "store/container/reader.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/queries.h"
#include "tools/python/src/sources.h"

namespace isonest::python {
namespace {

/// A kept analysis; its file is closed.
struct Analysis {
    std::filesystem::path path;
    std::string state;
    std::optional<std::string> query;
    std::optional<std::string> problem;
    std::vector<std::pair<double, std::uint64_t>>
        steps;  ///< pairs of a distance and a number of triangles
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
    CheckReport report;
    std::vector<Analysis> analyses;

    [[nodiscard]] bool ok() const {
        bool ok = report.failures == 0;
        for (const Analysis& analysis : analyses) {
            ok = ok && analysis.state != "damaged";
        }
        return ok;
    }
};

/// `source`: null, or the volume from which the store was made.
Checked check_store(const OpenStore& handle, bool quick, bool deep, Source* source,
                    std::uint64_t memory, int threads, const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    const std::unique_ptr<VolumeSource> volume = source != nullptr ? source->take() : nullptr;
    CheckOptions options;
    options.depth = quick ? CheckDepth::quick : deep ? CheckDepth::deep : CheckDepth::standard;
    options.source = volume.get();
    options.memory = memory;
    options.threads = threads;
    Checked checked;
    run_watched(progress, [&](Progress& p) {
        checked.report = check(*store, options, p);
        checked.analyses = analyses_of(*store, detail::AnalysisDepth::bytes);
    });
    return checked;
}

void add_reports_of_checks(py::module_& module) {
    py::class_<Finding>(module, "Finding", "One problem of a store.")
        .def_readonly("test", &Finding::test, "the test that found it, such as 'checksum'")
        .def_readonly("field", &Finding::field)
        .def_readonly("level", &Finding::level)
        .def_property_readonly(
            "chunk", [](const Finding& f) { return shape_of(f.chunk); }, "its index, (z, y, x)")
        .def_property_readonly(
            "node",
            [](const Finding& f) {
                return f.node.x < 0 ? py::object(py::none()) : py::object(shape_of(f.node));
            },
            "(z, y, x) on the finest lattice; None if the whole chunk is concerned")
        .def_readonly("message", &Finding::message)
        .def("__repr__", [](const Finding& f) {
            return py::str("Finding({}: level {}, {}: {})")
                .format(f.test, f.level, f.field, f.message);
        });
    py::class_<Analysis>(module, "Analysis", "A kept analysis of a surface; see keep_analysis=.")
        .def_readonly("path", &Analysis::path)
        .def_readonly("state", &Analysis::state,
                      "'current'; 'stale' or 'damaged' ones are replaced when they are used")
        .def_readonly("query", &Analysis::query,
                      "the surface in words; None if the file is damaged")
        .def_readonly("problem", &Analysis::problem, "why it is not current, or None")
        .def_readonly("steps", &Analysis::steps, "distance and number of triangles of each mesh");
    py::class_<Checked>(module, "CheckReport", "The report of Store.check.")
        .def_property_readonly("ok", &Checked::ok, "no problem was found")
        .def_property_readonly(
            "chunks", [](const Checked& c) { return c.report.chunks; },
            "chunks whose checksums were compared")
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

std::shared_ptr<const Store> OpenStore::get() const {
    if (!store_) {
        throw py::value_error("this store is closed");
    }
    return store_;
}

namespace {

using Numbers = std::array<std::int64_t, 3>;

std::unique_ptr<OpenStore> open_store(const std::filesystem::path& location,
                                      const std::vector<std::string>& headers,
                                      const std::filesystem::path& cache, std::uint64_t cache_bytes,
                                      std::uint64_t memory) {
    if (!is_url(location.native())) {
        const py::gil_scoped_release without;
        return std::make_unique<OpenStore>(std::make_shared<const Store>(location));
    }
    RemoteAccess remote;
    remote.headers = headers;
    remote.cache = cache;
    remote.cache_bytes = cache_bytes;
    remote.memory = memory;
    remote.check = check_running;
    std::shared_ptr<const Store> store;
    run_watched(py::none(), [&](Progress& /*progress*/) {
        store = std::make_shared<const Store>(location, remote);
    });
    return std::make_unique<OpenStore>(std::move(store));
}

/// Throws IndexError.
Int3 nodes_of(const Store& store, int level) {
    if (level < 0 || level >= store.levels()) {
        throw py::index_error("there is no level " + std::to_string(level) +
                              ": the levels are 0 to " + std::to_string(store.levels() - 1));
    }
    return nodes_of_level(store, level);
}

bool are_labels(const Store& store) {
    return store.reader().layout().header().labels;
}

/// The dtype of the values in Python; int64 for labels of 64 bits.
py::dtype dtype_of_values(const Store& store) {
    return are_labels(store) ? py::dtype("int64") : dtype_of(store.type());
}

/// A value returned by a reader as a Python number: a float, or an int for labels.
py::object value_of(const Store& store, double value) {
    const auto label = detail::wide_label(store.reader().layout().header(), value);
    return label ? py::object(py::int_(*label)) : py::object(py::float_(value));
}

/// Throws IndexError.
NodeBox box_in(const Store& store, int level, const Numbers& lo, const Numbers& hi) {
    const Int3 nodes = nodes_of(store, level);
    const NodeBox box{{lo[0], lo[1], lo[2]}, Int3{hi[0], hi[1], hi[2]} - Int3{lo[0], lo[1], lo[2]}};
    for (int axis = 0; axis < 3; ++axis) {
        if (box.lo[axis] < 0 || box.size[axis] < 0 || box.lo[axis] + box.size[axis] > nodes[axis]) {
            throw py::index_error("the box is not inside the level");
        }
    }
    return box;
}

std::vector<py::ssize_t> shape_of_box(const NodeBox& box) {
    return {box.size.z, box.size.y, box.size.x};
}

template <class T>
std::span<T> numbers_of(py::array& array) {
    return {static_cast<T*>(array.mutable_data()), static_cast<std::size_t>(array.size())};
}

py::array values(const OpenStore& handle, int level, const Numbers& lo, const Numbers& hi,
                 std::uint64_t memory, int threads, const py::object& report) {
    const std::shared_ptr<const Store> store = handle.get();
    const NodeBox box = box_in(*store, level, lo, hi);
    py::array result(dtype_of_values(*store), shape_of_box(box));
    const auto read = [&](auto tag) {
        const auto numbers = numbers_of<typename decltype(tag)::type>(result);
        run_watched(report, [&](Progress& progress) {
            read_values(*store, level, box, numbers, {memory, threads}, progress);
        });
    };
    if (are_labels(*store)) {
        read(TypeTag<std::int64_t>{});
    } else {
        dispatch(store->type(), read);
    }
    return result;
}

py::array indicator(const OpenStore& handle, const std::string& field, int level, const Numbers& lo,
                    const Numbers& hi, std::uint64_t memory, int threads,
                    const py::object& report) {
    const std::shared_ptr<const Store> store = handle.get();
    const Field found = indicator_of_name(field);
    const NodeBox box = box_in(*store, level, lo, hi);
    py::array result(py::dtype("float64"), shape_of_box(box));
    const auto numbers = numbers_of<double>(result);
    run_watched(report, [&](Progress& progress) {
        read_indicator(*store, found, level, box, numbers, {memory, threads}, progress);
    });
    return result;
}

/// `points`: rows of x, y, z.
py::array sampled(const OpenStore& handle, const py::array_t<double, py::array::c_style>& points,
                  int level, bool hexahedra, std::uint64_t memory, int threads,
                  const py::object& report) {
    const std::shared_ptr<const Store> store = handle.get();
    static_cast<void>(nodes_of(*store, level));
    static_assert(sizeof(Double3) == 3 * sizeof(double));
    const std::span<const Double3> rows(reinterpret_cast<const Double3*>(points.data()),
                                        static_cast<std::size_t>(points.shape(0)));
    py::array result(py::dtype("float64"), std::vector<py::ssize_t>{points.shape(0)});
    const auto numbers = numbers_of<double>(result);
    const SampleOptions options{level, hexahedra ? Cells::hexahedra : Cells::tetrahedra, memory,
                                threads};
    run_watched(report,
                [&](Progress& progress) { sample(*store, rows, numbers, options, progress); });
    return result;
}

Histogram histogram(const OpenStore& handle, std::optional<int> level, std::uint64_t memory,
                    int threads, const py::object& report) {
    const std::shared_ptr<const Store> store = handle.get();
    if (level) {
        static_cast<void>(nodes_of(*store, *level));
    }
    Histogram result;
    run_watched(report, [&](Progress& progress) {
        result = isonest::histogram(*store, {.level = level, .memory = memory, .threads = threads},
                                    progress);
    });
    return result;
}

/// Rows of id, number of nodes, and smallest and largest coordinates (x, y, z).
std::vector<std::array<std::int64_t, 8>> labels(const OpenStore& handle, std::uint64_t memory,
                                                int threads, const py::object& report) {
    const std::shared_ptr<const Store> store = handle.get();
    std::vector<std::array<std::int64_t, 8>> rows;
    run_watched(report, [&](Progress& progress) {
        for (const Label& l : find_labels(*store, {memory, threads}, progress)) {
            rows.push_back({l.id, static_cast<std::int64_t>(l.nodes), l.low.x, l.low.y, l.low.z,
                            l.high.x, l.high.y, l.high.z});
        }
    });
    return rows;
}

/// Rows of id, name and colour; None if unknown.
py::list label_names(const OpenStore& handle) {
    py::list rows;
    for (const LabelName& label : handle.get()->label_names()) {
        rows.append(py::make_tuple(
            label.id, label.name.empty() ? py::object(py::none()) : py::object(py::str(label.name)),
            label.color ? py::object(py::make_tuple((*label.color)[0], (*label.color)[1],
                                                    (*label.color)[2]))
                        : py::object(py::none())));
    }
    return rows;
}

/// The label with this name. Throws Error{not_found}, and Error{invalid_argument} if several labels
/// have it.
std::int64_t label_named(const OpenStore& handle, const std::string& name) {
    const std::shared_ptr<const Store> store = handle.get();
    const std::vector<std::int64_t> ids = store->labels_named(name);
    if (ids.size() != 1) {
        throw Error(ids.empty() ? ErrorKind::not_found : ErrorKind::invalid_argument,
                    {store->path().string()},
                    ids.empty() ? "there is no label '" + name + "'"
                                : std::to_string(ids.size()) + " labels are called '" + name + "'");
    }
    return ids.front();
}

template <class T>
py::array copied(const std::vector<T>& numbers) {
    return as_array(std::vector<T>(numbers));
}

/// REQUIRES: the histogram is of labels.
std::int64_t label_at(const Histogram& h, double value) {
    return *h.first_label + static_cast<std::int64_t>(std::round(value));
}

/// The lower ends of the bins; int64 for labels.
py::array lows(const Histogram& h) {
    if (!h.first_label) {
        return copied(h.bins.low);
    }
    std::vector<std::int64_t> labels;
    labels.reserve(h.bins.low.size());
    for (const double low : h.bins.low) {
        labels.push_back(label_at(h, low));
    }
    return copied(labels);
}

void add_histogram(py::module_& module) {
    py::class_<Histogram>(module, "Histogram")
        .def_readonly("level", &Histogram::level)
        .def_readonly("looked", &Histogram::looked)
        .def_readonly("missing", &Histogram::missing)
        .def_readonly("cube_level", &Histogram::cube_level)
        .def_property_readonly("low", [](const Histogram& h) { return lows(h); })
        .def_property_readonly("end",
                               [](const Histogram& h) {
                                   return h.first_label
                                              ? py::object(py::int_(label_at(h, h.bins.end)))
                                              : py::object(py::float_(h.bins.end));
                               })
        .def_property_readonly("nodes", [](const Histogram& h) { return copied(h.nodes); })
        .def_property_readonly("cubes", [](const Histogram& h) { return copied(h.cubes); })
        .def_property_readonly("suggested", [](const Histogram& h) {
            std::vector<std::pair<double, std::uint64_t>> all;
            all.reserve(h.suggested.size());
            for (const SuggestedIsovalue& s : h.suggested) {
                all.emplace_back(s.isovalue, s.cubes);
            }
            return all;
        });
}

}  // namespace

void add_stores(py::module_& module) {
    using namespace py::literals;
    py::class_<OpenStore>(module, "Store")
        .def(py::init(&open_store), "location"_a, "headers"_a, "cache"_a, "cache_bytes"_a,
             "memory"_a)
        .def("close", &OpenStore::close)
        .def_property_readonly("closed", &OpenStore::closed)
        .def_property_readonly("name", [](const OpenStore& s) { return s.get()->path().string(); })
        .def_property_readonly("is_remote", [](const OpenStore& s) { return s.get()->is_remote(); })
        .def_property_readonly("cache_warning",
                               [](const OpenStore& s) { return s.get()->cache_warning(); })
        .def_property_readonly("fetched",
                               [](const OpenStore& s) {
                                   const FetchedCounts counts = s.get()->fetched();
                                   py::dict all;
                                   all["remote_bytes"] = counts.remote_bytes;
                                   all["requests"] = counts.requests;
                                   all["round_trips"] = counts.round_trips;
                                   all["cache_bytes"] = counts.cache_bytes;
                                   return all;
                               })
        .def_property_readonly("shape",
                               [](const OpenStore& s) { return shape_of(s.get()->nodes()); })
        .def_property_readonly("dtype",
                               [](const OpenStore& s) { return dtype_of_values(*s.get()); })
        .def_property_readonly("spacing", [](const OpenStore& s) { return s.get()->spacing(); })
        .def_property_readonly("uneven",
                               [](const OpenStore& s) {
                                   const UnevenAxesPtr axes = s.get()->uneven_axes();
                                   return axes ? axes->offsets
                                               : std::array<std::vector<double>, 3>{};
                               })
        .def_property_readonly(
            "curved",
            [](const OpenStore& s) -> py::object {
                const CurvedNodesPtr nodes = s.get()->curved();
                if (!nodes) {
                    return py::none();
                }
                return py::dict(
                    "low"_a = nodes->low, "high"_a = nodes->high, "step"_a = nodes->step,
                    "mirrored"_a = nodes->mirrored, "folded"_a = nodes->folded,
                    "first_folded"_a = std::array{nodes->first_folded.x, nodes->first_folded.y,
                                                  nodes->first_folded.z});
            })
        .def(
            "positions",
            [](const OpenStore& s, const std::array<std::int64_t, 3>& first,
               const std::array<std::int64_t, 3>& size) {
                std::vector<Double3> found;
                {
                    const py::gil_scoped_release release;
                    found = s.get()->positions({first[0], first[1], first[2]},
                                               {size[0], size[1], size[2]});
                }
                py::array_t<double> out({size[2], size[1], size[0], std::int64_t{3}});
                std::copy_n(found.data()->data(), 3 * found.size(), out.mutable_data());
                return out;
            },
            "first"_a, "size"_a)
        .def_property_readonly("origin", [](const OpenStore& s) { return s.get()->origin(); })
        .def_property_readonly("frame",
                               [](const OpenStore& s) {
                                   const AnatomicalFrame frame = s.get()->frame();
                                   return frame == AnatomicalFrame::unknown
                                              ? std::nullopt
                                              : std::optional(std::string(name_of(frame)));
                               })
        .def_property_readonly("unit",
                               [](const OpenStore& s) -> std::optional<std::string> {
                                   const auto unit = s.get()->unit();
                                   return unit ? std::optional(std::string(symbol_of(*unit)))
                                               : std::nullopt;
                               })
        .def(
            "world_units",
            [](const OpenStore& s, double length, const std::string& unit) {
                return s.get()->world_units(length, unit_of_name(unit));
            },
            "length"_a, "unit"_a)
        .def_property_readonly("tolerance",
                               [](const OpenStore& s) { return s.get()->rounding().tolerance; })
        .def_property_readonly("direction", [](const OpenStore& s) { return s.get()->direction(); })
        .def_property_readonly("levels", [](const OpenStore& s) { return s.get()->levels(); })
        .def_property_readonly("indicators",
                               [](const OpenStore& s) { return names_of(s.get()->fields()); })
        .def_property_readonly(
            "min",
            [](const OpenStore& s) { return value_of(*s.get(), s.get()->reader().min_value()); })
        .def_property_readonly(
            "max",
            [](const OpenStore& s) { return value_of(*s.get(), s.get()->reader().max_value()); })
        .def_property_readonly("has_missing",
                               [](const OpenStore& s) { return s.get()->has_missing(); })
        .def_property_readonly(
            "format", [](const OpenStore& s) { return s.get()->reader().version().text(); })
        .def_property_readonly(
            "exact", [](const OpenStore& s) { return s.get()->reader().layout().header().exact; })
        .def_property_readonly(
            "chunk", [](const OpenStore& s) { return s.get()->reader().layout().header().chunk; })
        .def_property_readonly(
            "compression",
            [](const OpenStore& s) { return s.get()->reader().layout().header().compression; })
        .def_property_readonly("file_bytes",
                               [](const OpenStore& s) { return s.get()->reader().file_bytes(); })
        .def(
            "level_shape",
            [](const OpenStore& s, int level) { return shape_of(nodes_of(*s.get(), level)); },
            "level"_a)
        .def("values", &values, "level"_a, "lo"_a, "hi"_a, "memory"_a, "threads"_a, "progress"_a)
        .def("indicator", &indicator, "field"_a, "level"_a, "lo"_a, "hi"_a, "memory"_a, "threads"_a,
             "progress"_a)
        .def("sample", &sampled, "points"_a, "level"_a, "hexahedra"_a, "memory"_a, "threads"_a,
             "progress"_a)
        .def("histogram", &histogram, "level"_a, "memory"_a, "threads"_a, "progress"_a)
        .def("labels", &labels, "memory"_a, "threads"_a, "progress"_a)
        .def("label_names", &label_names)
        .def("label_named", &label_named, "name"_a);
    add_histogram(module);
    py::class_<Series>(module, "Series")
        .def(py::init<std::filesystem::path>(), "folder"_a)
        .def_property_readonly("path", &Series::folder)
        .def_property_readonly("times",
                               [](const Series& series) {
                                   std::vector<double> times;
                                   for (const SeriesStep& step : series.steps()) {
                                       times.push_back(step.time);
                                   }
                                   return times;
                               })
        .def_property_readonly("time_unit", &Series::time_unit)
        .def_property_readonly("stores", [](const Series& series) {
            std::vector<std::filesystem::path> stores;
            for (std::size_t i = 0; i < series.steps().size(); ++i) {
                stores.push_back(series.store(i));
            }
            return stores;
        });
}

}  // namespace isonest::python
