#include "tools/python/src/smoothing.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/export_field.h>
#include <isonest/smooth.h>
#include <isonest/study.h>

#include "query/finite_elements/volume_values.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/queries.h"
#include "tools/python/src/sources.h"
#include "tools/python/src/stores.h"

namespace isonest::python {
namespace {

/// `stored`: finds a field of the store.
AnyField any_field(const std::string& name, Field (*stored)(const std::string&)) {
    const auto computed = computed_field_from_name(name);
    return computed ? AnyField(*computed) : AnyField(stored(name));
}

void export_store_field(const OpenStore& handle, const std::filesystem::path& path,
                        const std::string& field, int level, bool replace, std::uint64_t memory,
                        const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    const AnyField named = any_field(field, field_of_name);
    run_watched(progress, [&](Progress& p) {
        export_field(*store, path, {named, level, replace, memory}, p);
    });
}

/// Returns (number of all elements, number of all cells, rows).
py::tuple study_store(const OpenStore& handle, const std::optional<std::vector<std::string>>& names,
                      StudyOptions options, const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    for (const std::string& name : names.value_or(std::vector<std::string>{})) {
        options.fields.push_back(any_field(name, indicator_of_name));
    }
    Study result;
    run_watched(progress, [&](Progress& p) { result = study(*store, options, p); });
    return py::make_tuple(result.all_elements, result.all_cells, std::move(result.rows));
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
    py::class_<R>(
        module, "StudyRow",
        "The mesh for one threshold of one field: refined where the field is not below it.")
        .def_property_readonly("field", [](const R& r) { return name_of(r.field); })
        .def_readonly("threshold", &R::threshold, "relative to the field's largest value")
        .def_readonly("visited", &R::visited, "visited cells of all levels")
        .def_readonly("leaves", &R::leaves, "elements of the mesh")
        .def_readonly("nodes", &R::nodes, "of the mesh")
        .def_property_readonly(
            "l1", [](const R& r) { return r.norms.l1; },
            "error of the function on the mesh, relative to the data's range; l1, l2 and linf are "
            "its norms")
        .def_property_readonly("l2", [](const R& r) { return r.norms.l2; })
        .def_property_readonly("linf", [](const R& r) { return r.norms.linf; })
        .def_property_readonly(
            "value_lp", [](const R& r) { return r.true_norms.value; },
            "with norm=: the integrated error in that norm")
        .def_property_readonly("gradient_lp", [](const R& r) { return r.true_norms.gradient; })
        .def_property_readonly("gradient_linf",
                               [](const R& r) { return r.true_norms.gradient_linf; })
        .def_readonly("graph_distance", &R::graph_distance, "with graph_distance=True")
        .def_readonly("iso_visited", &R::iso_visited,
                      "with iso=: elements visited when extracting it")
        .def_readonly("iso_leaves", &R::iso_leaves)
        .def("__repr__", [](const R& r) {
            return py::str("StudyRow({} at {:.3g}: leaves={}, linf={:.3g})")
                .format(name_of(r.field), r.threshold, r.leaves, r.norms.linf);
        });
    module.def("study", &study_store, "store"_a, "fields"_a, "options"_a, "progress"_a);
}

namespace {

struct SmoothArguments {
    SmoothOptions options;
    int steps = 0;
    std::set<int> snapshots;
    bool grid = false;
    std::optional<std::filesystem::path> output;
    bool replace = false;
};

/// The result of smoothing, in C++ memory.
struct Smoothed {
    Int3 nodes;
    std::vector<float> values;
    std::optional<std::vector<std::uint8_t>> grid;
    std::vector<SmoothStep> steps;
    std::vector<std::pair<int, std::vector<float>>> snapshots;
};

/// Progress of one step: can be cancelled like the whole run, but displays nothing, because
/// progress counts whole steps.
class WithinStep : public Progress {
  public:
    explicit WithinStep(const Progress& whole) : whole_(whole) {}
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    const Progress& whole_;
};

std::vector<float> copy_of(std::span<const float> values) {
    return {values.begin(), values.end()};
}

void write_values(const std::filesystem::path& path, const VolumeDescription& d, bool replace,
                  std::span<const float> values) {
    const auto file = detail::create_volume_file(
        path,
        {d.nodes, ValueType::f32, d.spacing, d.origin, d.direction, replace, d.unit, d.frame});
    file->write(reinterpret_cast<const std::byte*>(values.data()), d.nodes.z);
    file->finish();
}

/// `input`: a store or a volume.
template <class Input>
Smoothed smooth_values(Input& input, const VolumeDescription& d,
                       const std::vector<std::filesystem::path>& files, const SmoothArguments& a,
                       Progress& progress) {
    const auto require = [](bool is_right, const char* what) {
        if (!is_right) {
            throw Error(ErrorKind::invalid_argument, what);
        }
    };
    require(a.steps >= 0, "steps: give a number >= 0");
    require(a.snapshots.empty() || (*a.snapshots.begin() >= 0 && *a.snapshots.rbegin() <= a.steps),
            "snapshots: give numbers of steps, from 0 to steps");
    if (a.output) {
        detail::check_output(*a.output, a.replace, files);
    }
    Smoothing smoothing(input, a.options, progress);
    Smoothed result;
    result.nodes = smoothing.nodes();
    progress.begin("smooth", static_cast<std::uint64_t>(a.steps), "steps");
    WithinStep within(progress);
    for (int step = 0;; ++step) {
        if (a.snapshots.count(step) != 0) {
            result.snapshots.emplace_back(step, copy_of(smoothing.values()));
        }
        if (step == a.steps) {
            break;
        }
        result.steps.push_back(smoothing.step(within));
        progress.advance(1);
    }
    if (a.grid) {
        result.grid = smoothing.grid(within);
    }
    result.values = copy_of(smoothing.values());
    if (a.output) {
        write_values(*a.output, d, a.replace, result.values);
    }
    return result;
}

template <class T>
py::array as_volume(std::vector<T>&& values, const Int3& nodes) {
    return as_array(std::move(values)).reshape(std::vector<py::ssize_t>{nodes.z, nodes.y, nodes.x});
}

/// Returns (values, grid or None, steps, snapshots as pairs of a step and its values).
py::tuple as_tuple(Smoothed&& s) {
    py::object grid = py::none();
    if (s.grid) {
        grid = as_volume(std::move(*s.grid), s.nodes);
    }
    py::list snapshots;
    for (auto& [step, values] : s.snapshots) {
        snapshots.append(py::make_tuple(step, as_volume(std::move(values), s.nodes)));
    }
    return py::make_tuple(as_volume(std::move(s.values), s.nodes), std::move(grid),
                          std::move(s.steps), std::move(snapshots));
}

py::tuple smooth_source(Source& source, const SmoothArguments& arguments,
                        const py::object& progress) {
    const std::unique_ptr<VolumeSource> volume = source.take();
    Smoothed result;
    run_watched(progress, [&](Progress& p) {
        result = smooth_values(*volume, volume->describe(), volume->files(), arguments, p);
    });
    return as_tuple(std::move(result));
}

py::tuple smooth_store(const OpenStore& handle, const SmoothArguments& arguments,
                       const py::object& progress) {
    const std::shared_ptr<const Store> store = handle.get();
    Smoothed result;
    run_watched(progress, [&](Progress& p) {
        const VolumeDescription d = detail::VolumeValues(store->reader()).describe();
        result = smooth_values(*store, d, {store->path()}, arguments, p);
    });
    return as_tuple(std::move(result));
}

}  // namespace

void add_smoothing(py::module_& module) {
    using namespace py::literals;
    using O = SmoothArguments;
    using S = SmoothStep;
    py::class_<O> arguments(module, "SmoothOptions");
    const auto add_option = [&](const char* name, auto member) {
        using Value = std::decay_t<decltype(std::declval<SmoothOptions>().*member)>;
        arguments.def_property(
            name, [member](const O& o) { return o.options.*member; },
            [member](O& o, const Value& value) { o.options.*member = value; });
    };
    arguments.def(py::init<>());
    add_option("tau", &SmoothOptions::tau);
    add_option("lambda_", &SmoothOptions::lambda);
    add_option("sigma", &SmoothOptions::sigma);
    add_option("threshold", &SmoothOptions::threshold);
    add_option("memory", &SmoothOptions::memory);
    add_option("threads", &SmoothOptions::threads);
    arguments.def_readwrite("steps", &O::steps)
        .def_readwrite("snapshots", &O::snapshots)
        .def_readwrite("grid", &O::grid)
        .def_readwrite("output", &O::output)
        .def_readwrite("replace", &O::replace);
    py::class_<S>(module, "SmoothStep", "The report of a step of isonest.smooth.")
        .def_readonly("unknowns", &S::unknowns, "nodes of the grid")
        .def_readonly("iterations", &S::iterations, "of the solver")
        .def_readonly("residual", &S::residual)
        .def_readonly("mean", &S::mean, "of the function; not changed by a step")
        .def_readonly("variance", &S::variance, "of the function; not increased by a step")
        .def_readonly("least", &S::least)
        .def_readonly("largest", &S::largest)
        .def("__repr__", [](const S& s) {
            return py::str("SmoothStep(unknowns={}, iterations={}, mean={:.6g}, variance={:.6g})")
                .format(s.unknowns, s.iterations, s.mean, s.variance);
        });
    module.def("smooth", &smooth_source, "volume"_a, "options"_a, "progress"_a);
    module.def("smooth", &smooth_store, "volume"_a, "options"_a, "progress"_a);
}

}  // namespace isonest::python
