#include "tools/python/src/sources.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/march.h>
#include <isonest/memory_volume.h>
#include <isonest/open_volume.h>
#include <isonest/preprocess.h>
#include <isonest/tolerance.h>

#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/scaled_source.h"
#include "store/base/length_unit.h"
#include "tools/python/src/own_indicators.h"
#include "tools/python/src/progress.h"
#include "tools/python/src/queries.h"

namespace isonest::python {

py::dtype dtype_of(ValueType type) {
    return py::dtype(std::string(name_of(type)));
}

ValueType value_type_of(const py::dtype& dtype) {
    const auto name = dtype.attr("name").cast<std::string>();
    const std::optional<ValueType> type = value_type_from_name(name);
    if (!type) {
        throw py::type_error("a volume of " + name +
                             ": the types are integers of 8, 16 and 32 bits, float32 and float64");
    }
    return *type;
}

std::unique_ptr<VolumeSource> Source::take() {
    static_cast<void>(volume());
    return std::move(volume_);
}

VolumeSource& Source::volume() const {
    if (!volume_) {
        throw py::value_error("this source has already been used; make another one");
    }
    return *volume_;
}

namespace {

using Path = std::filesystem::path;
using Numbers = std::array<std::int64_t, 3>;

Int3 int3_of(const Numbers& n) {
    return {n[0], n[1], n[2]};
}

/// A volume in the memory of a NumPy array with any strides; keeps the array alive.
class ArrayVolume : public MemoryVolume {
  public:
    ArrayVolume(py::array array, MemoryLayout layout, bool identified, std::vector<Path> files)
        : MemoryVolume(array.data(), value_type_of(array.dtype()),
                       {array.shape(2), array.shape(1), array.shape(0)}, std::move(layout)),
          array_(std::move(array)),
          identified_(identified),
          files_(std::move(files)) {}
    ~ArrayVolume() override {
        const py::gil_scoped_acquire with;
        array_.release().dec_ref();
    }
    ArrayVolume(const ArrayVolume&) = delete;
    ArrayVolume& operator=(const ArrayVolume&) = delete;

    /// Computing the digest reads all values once more, so this is done only for a resumable run.
    [[nodiscard]] std::string identity() const override {
        return identified_ ? MemoryVolume::identity() : "";
    }
    [[nodiscard]] std::vector<Path> files() const override { return files_; }

  private:
    py::array array_;
    bool identified_;
    std::vector<Path> files_;
};

/// A volume read through a Python object with a method read(z0, z1, y0, y1), which returns a dense
/// array of the volume's type. The GIL is held for one such call at a time.
class ReaderVolume : public VolumeSource {
  public:
    ReaderVolume(py::object reader, VolumeDescription description, Granularity granularity,
                 std::uint64_t heap, std::string identity, std::vector<Path> files)
        : reader_(std::move(reader)),
          description_(std::move(description)),
          granularity_(granularity),
          heap_(heap),
          identity_(std::move(identity)),
          files_(std::move(files)) {}
    ~ReaderVolume() override {
        const py::gil_scoped_acquire with;
        reader_.release().dec_ref();
    }
    ReaderVolume(const ReaderVolume&) = delete;
    ReaderVolume& operator=(const ReaderVolume&) = delete;

    [[nodiscard]] VolumeDescription describe() const override { return description_; }
    [[nodiscard]] std::string identity() const override { return identity_; }
    [[nodiscard]] Granularity granularity() const override { return granularity_; }
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }
    [[nodiscard]] std::vector<Path> files() const override { return files_; }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const std::int64_t row =
            description_.nodes.x * static_cast<std::int64_t>(size_of(description_.type));
        for (std::int64_t z = z0; z < z0 + nz;) {
            const std::int64_t z1 = std::min(z0 + nz, next(z, granularity_.planes));
            for (std::int64_t y = y0; y < y0 + ny;) {
                const std::int64_t y1 = std::min(y0 + ny, next(y, granularity_.rows));
                const py::gil_scoped_acquire with;
                const py::array slab = reader_.attr("read")(z, z1, y, y1);
                const auto piece = static_cast<std::size_t>((y1 - y) * row);
                if (slab.nbytes() != (z1 - z) * static_cast<std::int64_t>(piece) ||
                    (slab.flags() & py::array::c_style) == 0) {
                    throw Error(ErrorKind::io, {description_.name},
                                "a slice of it has the wrong shape");
                }
                for (std::int64_t i = 0; i < z1 - z; ++i) {
                    std::memcpy(dst + ((z - z0 + i) * ny + (y - y0)) * row,
                                static_cast<const std::byte*>(slab.data()) +
                                    static_cast<std::size_t>(i) * piece,
                                piece);
                }
                y = y1;
            }
            z = z1;
        }
    }

  private:
    static std::int64_t next(std::int64_t at, std::int64_t step) { return (at / step + 1) * step; }

    py::object reader_;
    VolumeDescription description_;
    Granularity granularity_;
    std::uint64_t heap_;
    std::string identity_;
    std::vector<Path> files_;
};

Source with_missing(std::unique_ptr<VolumeSource> volume, std::optional<double> missing) {
    if (missing) {
        volume = detail::with_missing(std::move(volume), *missing);
    }
    return Source(std::move(volume));
}

using Range = std::pair<std::optional<std::int64_t>, std::optional<std::int64_t>>;

std::optional<LengthUnit> unit_of(const std::optional<std::string>& name) {
    return name ? std::optional(unit_of_name(*name)) : std::nullopt;
}

AnatomicalFrame frame_of(const std::optional<std::string>& name) {
    if (!name) {
        return AnatomicalFrame::unknown;
    }
    const std::optional<AnatomicalFrame> frame = frame_from(*name);
    if (!frame) {
        throw py::value_error("frame='" + *name + "': give 'RAS' or 'LPS'");
    }
    return *frame;
}

/// Adds SourceOptions, which Python fills in.
void add_source_options(py::module_& module) {
    using O = SourceOptions;
    py::class_<O>(module, "SourceOptions")
        .def(py::init<>())
        .def_readwrite("dataset", &O::dataset)
        .def_readwrite("series", &O::series)
        .def_readwrite("labels", &O::labels)
        .def_readwrite("label_names", &O::label_names)
        .def_readwrite("offset", &O::offset)
        .def_readwrite("big_endian", &O::big_endian)
        .def_readwrite("spacing", &O::spacing)
        .def_readwrite("origin", &O::origin)
        .def_readwrite("missing", &O::missing)
        .def_readwrite("max_heap", &O::max_heap)
        .def("add_index",
             [](O& o, const std::string& axis, std::optional<std::int64_t> at) {
                 o.index.push_back({axis, at});
             })
        .def("set_unit", [](O& o, const std::string& unit) { o.unit = unit_of_name(unit); })
        .def("set_frame", [](O& o, const std::string& frame) { o.frame = frame_of(frame); })
        .def("set_dims", [](O& o, const Numbers& dims) { o.dims = int3_of(dims); })
        .def("set_dtype", [](O& o, const py::dtype& dtype) { o.type = value_type_of(dtype); })
        .def("set_crop",
             [](O& o, const std::array<Range, 3>& crop) {
                 for (std::size_t axis = 0; axis < crop.size(); ++axis) {
                     o.crop.at(axis) = {crop.at(axis).first, crop.at(axis).second};
                 }
             })
        .def("set_remote",
             [](O& o, std::vector<std::string> headers, const Path& cache,
                std::uint64_t cache_bytes, std::uint64_t memory) {
                 o.remote.headers = std::move(headers);
                 o.remote.cache = cache;
                 o.remote.cache_bytes = cache_bytes;
                 o.remote.memory = memory;
                 o.remote.check = check_running;
             })
        .def("set_every", [](O& o, const Numbers& every) { o.every = int3_of(every); })
        .def("set_periodic", [](O& o, const std::array<bool, 3>& periodic, const Numbers& repeat) {
            o.periodic = periodic;
            o.repeat = int3_of(repeat);
        });
}

Source source_of_files(const std::vector<Path>& paths, const SourceOptions& options) {
    std::unique_ptr<VolumeSource> volume;
    // Opening a remote volume may take long, so Ctrl-C must work.
    run_watched(py::none(), [&](Progress& /*progress*/) { volume = open_volume(paths, options); });
    return Source(std::move(volume));
}

Source source_of_array(py::array array, const Double3& spacing, const Double3& origin,
                       const Directions& direction, const std::optional<std::string>& unit,
                       const std::optional<std::string>& frame, std::string name, bool identified,
                       std::vector<Path> files, std::optional<double> missing,
                       detail::UnevenCoordinates uneven) {
    if (array.ndim() != 3) {
        throw py::value_error("a volume has three axes");
    }
    MemoryLayout layout;
    layout.strides = Int3{array.strides(2), array.strides(1), array.strides(0)};
    layout.spacing = spacing;
    layout.origin = origin;
    layout.unit = unit_of(unit);
    layout.frame = frame_of(frame);
    layout.direction = direction;
    layout.name = std::move(name);
    auto volume = std::make_unique<ArrayVolume>(std::move(array), std::move(layout), identified,
                                                std::move(files));
    return with_missing(detail::with_uneven_axes(std::move(volume), std::move(uneven)), missing);
}

Source source_of_reader(py::object reader, const Numbers& nodes, const py::dtype& dtype,
                        const Double3& spacing, const Double3& origin, const Directions& direction,
                        const std::optional<std::string>& unit,
                        const std::optional<std::string>& frame, std::string name,
                        std::int64_t planes, std::int64_t rows, std::uint64_t heap,
                        std::string identity, std::vector<Path> files,
                        std::optional<double> missing, detail::UnevenCoordinates uneven) {
    VolumeDescription description{int3_of(nodes), value_type_of(dtype), spacing,
                                  origin,         std::move(name),      direction,
                                  false,          unit_of(unit),        frame_of(frame)};
    const VolumeSource::Granularity granularity{std::max<std::int64_t>(planes, 1),
                                                std::max<std::int64_t>(rows, 1)};
    auto volume =
        std::make_unique<ReaderVolume>(std::move(reader), std::move(description), granularity, heap,
                                       std::move(identity), std::move(files));
    return with_missing(detail::with_uneven_axes(std::move(volume), std::move(uneven)), missing);
}

ValueTolerance tolerance_of(const std::string& kind, double number) {
    if (kind == "auto") {
        return WithinNoise{};
    }
    if (kind == "bits") {
        return WithoutLowBits{static_cast<int>(number)};
    }
    return kind == "range" ? ValueTolerance(WithinRangePart{number})
                           : ValueTolerance(WithinValue{number});
}

/// Reads the values if the tolerance depends on them; the source cannot be used again.
DataRounding rounding_of_source(Source& source, const std::string& kind, double number,
                                std::uint64_t memory, const py::object& progress) {
    const ValueTolerance tolerance = tolerance_of(kind, number);
    const std::unique_ptr<VolumeSource> volume = source.take();
    ValueSurvey survey;
    if (needs_survey(tolerance)) {
        run_watched(progress,
                    [&](Progress& p) { survey = survey_values(*volume, tolerance, memory, p); });
    }
    return rounding_of(tolerance, volume->describe().type, survey);
}

/// (spacing, origin, direction, axes to reverse) of a volume with these steps between its nodes.
py::tuple place_of_steps(const Numbers& nodes, const std::array<Double3, 3>& steps,
                         const Double3& first, const std::string& name) {
    const detail::Placement place = detail::place_in_world(int3_of(nodes), steps, first, name);
    return py::make_tuple(place.spacing, place.origin, place.direction, place.backward);
}

/// Name, coordinates and unit of an axis.
using CoordinatesOfAxis = std::tuple<std::string, std::vector<double>, std::string>;

/// (step, position of the first node, symbol of the unit or None, coordinates of uneven axes) of a
/// volume whose axes have coordinates.
py::tuple place_of_coordinates(const Numbers& nodes,
                               const std::array<std::optional<CoordinatesOfAxis>, 3>& axes,
                               const std::string& name) {
    std::array<std::optional<detail::AxisCoordinates>, 3> given;
    for (std::size_t axis = 0; axis < given.size(); ++axis) {
        if (axes.at(axis)) {
            const auto& [of_axis, numbers, unit] = *axes.at(axis);
            given.at(axis) = detail::AxisCoordinates{of_axis, numbers, unit};
        }
    }
    const detail::CoordinatePlace place =
        detail::place_by_coordinates(given, int3_of(nodes), {}, name);
    return py::make_tuple(
        place.step, place.first,
        place.unit ? std::optional(std::string(symbol_of(*place.unit))) : std::nullopt,
        place.uneven);
}

PreprocessReport preprocess_source(Source& source, const Path& store,
                                   const PreprocessOptions& options, const py::object& progress) {
    const std::unique_ptr<VolumeSource> volume = source.take();
    PreprocessReport report;
    run_watched(progress, [&](Progress& p) { report = preprocess(*volume, store, options, p); });
    return report;
}

}  // namespace

void add_sources(py::module_& module) {
    using namespace py::literals;
    py::class_<Source>(module, "Source")
        .def_property_readonly("origin",
                               [](const Source& s) { return s.volume().describe().origin; })
        .def_property_readonly("direction",
                               [](const Source& s) { return s.volume().describe().direction; })
        .def_property_readonly("fetched",
                               [](const Source& s) {
                                   const FetchedCounts counts = s.volume().fetched();
                                   return py::dict("remote_bytes"_a = counts.remote_bytes,
                                                   "requests"_a = counts.requests,
                                                   "round_trips"_a = counts.round_trips,
                                                   "cache_bytes"_a = counts.cache_bytes);
                               })
        .def_property_readonly("cache_warning",
                               [](const Source& s) { return s.volume().cache_warning(); })
        .def(
            "world_units",
            [](const Source& s, double length, const std::string& unit) {
                const VolumeDescription volume = s.volume().describe();
                return detail::world_units(length, unit_of_name(unit), volume.unit, volume.name);
            },
            "length"_a, "unit"_a)
        .def(
            "march_memory",
            [](const Source& s, const AskedSurface& asked) {
                return march_memory(s.volume(), asked.query);
            },
            "query"_a);
    add_source_options(module);
    module.def("source_of_files", &source_of_files, "paths"_a, "options"_a);
    module.def("source_of_array", &source_of_array, "array"_a, py::kw_only(), "spacing"_a,
               "origin"_a, "direction"_a, "unit"_a, "frame"_a, "name"_a, "identified"_a, "files"_a,
               "missing"_a, "uneven"_a);
    module.def("source_of_reader", &source_of_reader, "reader"_a, py::kw_only(), "nodes"_a,
               "dtype"_a, "spacing"_a, "origin"_a, "direction"_a, "unit"_a, "frame"_a, "name"_a,
               "planes"_a, "rows"_a, "heap"_a, "identity"_a, "files"_a, "missing"_a, "uneven"_a);

    module.def("place_of_steps", &place_of_steps, "nodes"_a, "steps"_a, "first"_a, "name"_a);
    module.def("place_of_coordinates", &place_of_coordinates, "nodes"_a, "axes"_a, "name"_a);
    module.def("input_format_of", &input_format_of, "path"_a);

    py::class_<DataRounding>(module, "DataRounding")
        .def_readonly("tolerance", &DataRounding::tolerance)
        .def_readonly("step", &DataRounding::step);
    module.def("rounding_of", &rounding_of_source, "source"_a, "kind"_a, "number"_a, "memory"_a,
               "progress"_a);
    py::class_<PreprocessOptions> options(module, "PreprocessOptions");
    options.def(py::init<>())
        .def_readwrite("memory", &PreprocessOptions::memory)
        .def_readwrite("threads", &PreprocessOptions::threads)
        .def_readwrite("chunk", &PreprocessOptions::chunk)
        .def_readwrite("compression", &PreprocessOptions::compression)
        .def_readwrite("exact", &PreprocessOptions::exact)
        .def_readwrite("replace", &PreprocessOptions::force)
        .def_readwrite("resume", &PreprocessOptions::resume)
        .def_readwrite("rounding", &PreprocessOptions::rounding)
        .def_property(
            "indicators", [](const PreprocessOptions& o) { return names_of(o.fields); },
            [](PreprocessOptions& o, const std::vector<std::string>& names) {
                o.fields = indicators_of_names(names);
            });
    add_own_indicators(options);
    module.def("preprocess", &preprocess_source, "source"_a, "store"_a, "options"_a, "progress"_a);
}

}  // namespace isonest::python
