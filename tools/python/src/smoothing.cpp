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

#include "query/extract/export.h"
#include "query/finite_elements/nonlinear_diffusion.h"
#include "query/study/computed_field.h"
#include "query/study/study.h"
#include "store/base/memory.h"
#include "store/container/format.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "tools/cli/commands/volume_values.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/queries.h"
#include "tools/python/src/sources.h"
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

/// The fields with these names; without names, all fields of the store that can be studied.
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

/// Returns (number of all elements, number of all cells, rows).
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

namespace {

using detail::DiffusionStep;
using detail::NonlinearDiffusion;
using detail::cli::VolumeValues;

struct SmoothOptions {
    detail::DiffusionOptions diffusion;
    std::optional<double> sigma;  ///< none: the smallest spacing
    int steps = 0;
    std::set<int> snapshots;
    bool grid = false;
    std::optional<std::filesystem::path> output;
    bool replace = false;
    std::uint64_t memory = std::uint64_t{1} << 30U;
};

/// The result of smoothing, in C++ memory.
struct Smoothed {
    Int3 nodes;
    std::vector<float> values;
    std::optional<std::vector<std::uint8_t>> grid;
    std::vector<DiffusionStep> steps;
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

double smallest_spacing(const VolumeDescription& d) {
    double nearest = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double s = d.spacing.at(static_cast<std::size_t>(axis));
        nearest = d.nodes[axis] > 1 && (nearest == 0 || s < nearest) ? s : nearest;
    }
    return nearest;
}

std::vector<std::uint8_t> members_of(const NodeSet& grid) {
    const Int3 nodes = grid.nodes();
    std::vector<std::uint8_t> members(static_cast<std::size_t>(nodes.product()), 0);
    for (std::int64_t row = 0; row < nodes.y * nodes.z; ++row) {
        const Int3 p{0, row % nodes.y, row / nodes.y};
        grid.for_row(p, nodes.x, [&](std::int64_t x, std::uint64_t) {
            members[static_cast<std::size_t>(row * nodes.x + x)] = 1;
        });
    }
    return members;
}

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

/// Checks the options before any work. Throws Error{invalid_argument, unsupported}.
void require_sense(const SmoothOptions& o, const detail::Lattice& lattice,
                   const std::string& name) {
    const auto require = [](bool is_right, const char* what) {
        if (!is_right) {
            throw Error(ErrorKind::invalid_argument, what);
        }
    };
    require(o.steps >= 0, "steps: give a number >= 0");
    require(o.diffusion.tau > 0, "tau: give a number > 0");
    require(o.diffusion.lambda > 0, "lambda_: give a number > 0");
    require(!o.sigma || *o.sigma >= 0, "sigma: give a number >= 0");
    require(o.diffusion.threshold >= 0, "threshold: give a number >= 0");
    require(o.snapshots.empty() || (*o.snapshots.begin() >= 0 && *o.snapshots.rbegin() <= o.steps),
            "snapshots: give numbers of steps, from 0 to steps");
    if (lattice.dimension() == 0) {
        throw Error(ErrorKind::unsupported, {name}, "there is only one node");
    }
}

Smoothed smooth_values(VolumeValues& input, SmoothOptions o, Progress& progress) {
    const VolumeDescription d = input.describe();
    detail::require_right_angles(d.direction, d.name, "smoothing");
    const detail::Lattice lattice(d.nodes);
    require_sense(o, lattice, d.name);
    if (o.output) {
        detail::check_output(*o.output, o.replace, input.files());
    }
    o.diffusion.sigma = o.sigma.value_or(smallest_spacing(d));
    detail::require_memory(
        d.name, o.memory,
        detail::kLibraryHeap + input.heap() + NonlinearDiffusion::heap(lattice, o.diffusion),
        "this many unknowns");
    Smoothed result;
    result.nodes = d.nodes;
    NonlinearDiffusion diffusion(lattice, d.spacing, input.read(progress), o.diffusion);
    progress.begin("smooth", static_cast<std::uint64_t>(o.steps), "steps");
    WithinStep within(progress);
    for (int step = 0;; ++step) {
        if (o.snapshots.count(step) != 0) {
            result.snapshots.emplace_back(step, copy_of(diffusion.values()));
        }
        if (step == o.steps) {
            break;
        }
        result.steps.push_back(diffusion.step(within));
        progress.advance(1);
    }
    if (o.grid) {
        result.grid = members_of(diffusion.grid(within));
    }
    result.values = copy_of(diffusion.values());
    if (o.output) {
        write_values(*o.output, d, o.replace, result.values);
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

py::tuple smooth_source(Source& source, const SmoothOptions& options, const py::object& progress) {
    std::unique_ptr<VolumeSource> volume = source.take();
    const std::string name = volume->describe().name;
    VolumeValues input(std::move(volume), name);
    Smoothed result;
    run_watched(progress, [&](Progress& p) { result = smooth_values(input, options, p); });
    return as_tuple(std::move(result));
}

py::tuple smooth_store(const OpenStore& store, const SmoothOptions& options,
                       const py::object& progress) {
    VolumeValues input(store.get());
    Smoothed result;
    run_watched(progress, [&](Progress& p) { result = smooth_values(input, options, p); });
    return as_tuple(std::move(result));
}

}  // namespace

void add_smoothing(py::module_& module) {
    using namespace py::literals;
    using O = SmoothOptions;
    using S = DiffusionStep;
    py::class_<O>(module, "SmoothOptions")
        .def(py::init<>())
        .def_property(
            "tau", [](const O& o) { return o.diffusion.tau; },
            [](O& o, double tau) { o.diffusion.tau = tau; })
        .def_property(
            "lambda_", [](const O& o) { return o.diffusion.lambda; },
            [](O& o, double lambda) { o.diffusion.lambda = lambda; })
        .def_property(
            "threshold", [](const O& o) { return o.diffusion.threshold; },
            [](O& o, double threshold) { o.diffusion.threshold = threshold; })
        .def_property(
            "threads", [](const O& o) { return o.diffusion.threads; },
            [](O& o, int threads) { o.diffusion.threads = threads; })
        .def_readwrite("sigma", &O::sigma)
        .def_readwrite("steps", &O::steps)
        .def_readwrite("snapshots", &O::snapshots)
        .def_readwrite("grid", &O::grid)
        .def_readwrite("output", &O::output)
        .def_readwrite("replace", &O::replace)
        .def_readwrite("memory", &O::memory);
    py::class_<S>(module, "SmoothStep", "What a step of isonest.smooth did.")
        .def_readonly("unknowns", &S::unknowns, "nodes of the grid")
        .def_readonly("iterations", &S::iterations, "of the solver")
        .def_readonly("residual", &S::residual)
        .def_readonly("mean", &S::mean, "of the function, which a step does not change")
        .def_readonly("variance", &S::variance, "which a step does not raise")
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
