// isonest preprocess --times: a store for each step in time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <set>
#include <span>
#include <string_view>
#include <utility>

#include <isonest/error.h>
#include <isonest/series.h>
#include <isonest/store.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "query/values/label_view.h"
#include "store/base/checksum.h"
#include "store/container/reader.h"
#include "tools/cli/commands/preprocess_command.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

/// The input of a step.
struct StepInput {
    std::string file;
    std::vector<AxisIndex> index;
    std::optional<std::int64_t> at;  ///< on the axis of times; none: the file is one step
    VolumeDescription description;
    double time = 0;

    [[nodiscard]] std::string name() const {
        return at ? fmt::format("{}, time step {}", file, *at) : file;
    }
};

/// Where the times come from, as reported.
enum class TimeOrigin { given, coordinates, names, counted };

const char* text_of(TimeOrigin origin) {
    switch (origin) {
        case TimeOrigin::given:
            return "given by --times";
        case TimeOrigin::coordinates:
            return "the coordinates in the input";
        case TimeOrigin::names:
            return "the numbers in the file names";
        default:
            return "counted from 0";
    }
}

/// The arguments for one step; only `store` is missing.
PreprocessArguments arguments_of(const PreprocessArguments& all, const StepInput& step) {
    PreprocessArguments own = all;
    own.input = {step.file};
    own.source.index = step.index;
    own.times.reset();
    own.append = false;
    return own;
}

std::unique_ptr<VolumeSource> open_step(const PreprocessArguments& all, const StepInput& step,
                                        Progress& progress) {
    PreprocessArguments own = arguments_of(all, step);
    reach_volume(own.input, own.remote, own.preprocess.memory, own.source, progress);
    own.source.max_heap = own.preprocess.memory / 4;
    return open_input(own.input, {}, own.source);
}

/// The entry of the index that takes a whole axis of times; null if there is none.
const AxisIndex* whole_times(const std::vector<AxisIndex>& index) {
    const auto found = std::find_if(index.begin(), index.end(), [](const AxisIndex& entry) {
        return !entry.at && is_time_name(entry.axis);
    });
    return found == index.end() ? nullptr : &*found;
}

/// The steps of one file.
std::vector<StepInput> steps_in(const PreprocessArguments& a, const std::string& file,
                                Progress& progress) {
    const auto described = [&](StepInput step) {
        progress.check();
        step.description = open_step(a, step, progress)->describe();
        return step;
    };
    const AxisIndex* const whole = whole_times(a.source.index);
    if (whole == nullptr) {
        return {described({file, a.source.index, {}, {}})};
    }
    const auto at = [&](std::int64_t position) {
        std::vector<AxisIndex> index = a.source.index;
        index[static_cast<std::size_t>(whole - a.source.index.data())].at = position;
        return described({file, std::move(index), position, {}});
    };
    std::vector<StepInput> steps{at(0)};
    const std::optional<VolumeTime>& time = steps.front().description.time;
    if (!time) {
        throw Error(ErrorKind::unsupported, {file},
                    fmt::format("the number of its time steps is unknown; name each step: "
                                "--index {0}=0, --index {0}=1, ...",
                                whole->axis));
    }
    const std::int64_t count = time->steps;
    for (std::int64_t i = 1; i < count; ++i) {
        steps.push_back(at(i));
    }
    return steps;
}

/// The last number in a file's name, 12 of run_0012.nc or 0.5 of t0.5.nrrd, and what is before it.
struct NumberedName {
    std::string before;
    double number = 0;
    /// The digits on both sides of the point as whole numbers; the second is 0 without a point.
    std::array<double, 2> parts{};
};

std::optional<NumberedName> numbered_name(const std::string& file) {
    std::filesystem::path path(file);
    path = path.has_filename() ? path : path.parent_path();
    path.replace_extension();
    if (path.extension() == ".nii" || path.extension() == ".raw") {  // of .nii.gz
        path.replace_extension();
    }
    const std::string name = path.filename().string();
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    std::size_t end = name.size();
    while (end > 0 && !is_digit(name[end - 1])) {
        --end;
    }
    std::size_t begin = end;
    std::size_t point = end;
    while (begin > 0 &&
           (is_digit(name[begin - 1]) || (point == end && name[begin - 1] == '.' && begin > 1 &&
                                          begin < end && is_digit(name[begin - 2])))) {
        --begin;
        point = name[begin] == '.' ? begin : point;
    }
    const auto number = [&](std::size_t from, std::size_t to) {
        double value = 0;
        const char* const last = name.data() + to;
        const auto [at, error] = std::from_chars(name.data() + from, last, value);
        return error == std::errc{} && at == last ? std::optional(value) : std::nullopt;
    };
    const std::optional<double> whole = end > begin ? number(begin, end) : std::nullopt;
    if (!whole) {
        return std::nullopt;
    }
    return NumberedName{
        name.substr(0, begin),
        *whole,
        {number(begin, point).value_or(0), point < end ? number(point + 1, end).value_or(0) : 0}};
}

bool have_coordinates(const std::vector<StepInput>& steps) {
    return std::all_of(steps.begin(), steps.end(), [&](const StepInput& step) {
        const std::optional<VolumeTime>& time = step.description.time;
        return time && time->value && std::isfinite(*time->value) &&
               time->unit == steps.front().description.time->unit;
    });
}

/// Whether the names of the files differ in their last number alone. Throws
/// Error{invalid_argument} if the order of the numbers depends on whether the point is a decimal
/// point: 1.9 and 1.10.
bool have_own_numbers(const std::vector<StepInput>& steps) {
    std::vector<NumberedName> names;
    for (const StepInput& step : steps) {
        std::optional<NumberedName> name = numbered_name(step.file);
        if (step.at || !name || (!names.empty() && name->before != names.front().before)) {
            return false;
        }
        names.push_back(std::move(*name));
    }
    const auto by_number = [](const auto& a, const auto& b) { return a.number < b.number; };
    std::sort(names.begin(), names.end(), by_number);
    if (std::adjacent_find(names.begin(), names.end(), std::not_fn(by_number)) != names.end()) {
        return false;
    }
    const bool same_order = std::is_sorted(
        names.begin(), names.end(), [](const auto& a, const auto& b) { return a.parts < b.parts; });
    if (!same_order) {
        throw Error(ErrorKind::invalid_argument, {steps.front().file},
                    "the order of the file names is unclear: as decimal numbers, 1.10 comes before "
                    "1.5, but part by part after it; give the times with --times");
    }
    return true;
}

/// Sets the times of the steps and sorts by them.
TimeOrigin set_times(const std::optional<NewTimes>& given, std::vector<StepInput>& steps) {
    TimeOrigin origin = TimeOrigin::counted;
    if (given && !given->from_input) {
        const std::vector<double> times = times_of(*given, steps.size());
        for (std::size_t i = 0; i < steps.size(); ++i) {
            steps[i].time = times[i];
        }
        return TimeOrigin::given;
    }
    if (have_coordinates(steps)) {
        origin = TimeOrigin::coordinates;
    } else if (have_own_numbers(steps)) {
        origin = TimeOrigin::names;
    }
    for (std::size_t i = 0; i < steps.size(); ++i) {
        steps[i].time = origin == TimeOrigin::coordinates ? *steps[i].description.time->value
                        : origin == TimeOrigin::names     ? numbered_name(steps[i].file)->number
                                                          : static_cast<double>(i);
    }
    std::stable_sort(steps.begin(), steps.end(),
                     [](const StepInput& x, const StepInput& y) { return x.time < y.time; });
    for (std::size_t i = 1; i < steps.size(); ++i) {
        if (steps[i].time == steps[i - 1].time) {
            throw Error(
                ErrorKind::invalid_argument, {steps[i].name()},
                fmt::format("its time, {}, is also that of {}; set other times with --times",
                            time_text(steps[i].time), steps[i - 1].name()));
        }
    }
    return origin;
}

std::string type_of(const VolumeDescription& d) {
    return std::string(d.labels ? "int64" : name_of(d.type));
}

/// The description of the volume that a store was made from, as far as the store has it.
VolumeDescription description_of(const Store& store) {
    VolumeDescription d;
    d.nodes = store.nodes();
    d.type = store.type();
    d.labels = store.reader().layout().header().labels;
    d.spacing = store.spacing();
    d.uneven = store.uneven_axes();
    // That there are positions; each step has its own.
    d.curved = store.curved() ? std::make_shared<const NodePositions>() : nullptr;
    d.origin = store.origin();
    d.direction = store.direction();
    d.unit = store.unit();
    d.frame = store.frame();
    return d;
}

/// Why a volume cannot be in a series with another one; empty if it can.
std::string difference(const VolumeDescription& own, const VolumeDescription& first) {
    const auto nodes = [](const Int3& n) { return fmt::format("{} x {} x {}", n.x, n.y, n.z); };
    const auto three = [](const Double3& v) { return fmt::format("{},{},{}", v[0], v[1], v[2]); };
    const auto unit = [](const VolumeDescription& d) {
        return d.unit ? std::string(symbol_of(*d.unit)) : std::string("unknown");
    };
    const auto but = [](const char* what, const std::string& is, const std::string& was) {
        return fmt::format("its {} {}, but {} in the series", what, is, was);
    };
    if (own.nodes != first.nodes) {
        return but("nodes are", nodes(own.nodes), nodes(first.nodes));
    }
    if (type_of(own) != type_of(first)) {
        return but("values are", type_of(own), type_of(first));
    }
    if (own.spacing != first.spacing) {
        return but("spacing is", three(own.spacing), three(first.spacing));
    }
    if ((own.uneven == nullptr) != (first.uneven == nullptr) ||
        (own.uneven && *own.uneven != *first.uneven)) {
        return "its nodes lie at other places along the axes than those of the series";
    }
    if ((own.curved == nullptr) != (first.curved == nullptr)) {
        return "one of them is a curvilinear grid and the other is not";
    }
    if (own.origin != first.origin) {
        return but("origin is", three(own.origin), three(first.origin));
    }
    if (own.direction != first.direction) {
        return "its axes have other directions than those of the series";
    }
    if (own.unit != first.unit) {
        return but("unit is", unit(own), unit(first));
    }
    if (own.frame != first.frame) {
        return "its patient axes differ from those of the series";
    }
    return "";
}

void require_same_grid(const std::vector<StepInput>& steps, const VolumeDescription& first,
                       const std::string& of) {
    for (const StepInput& step : steps) {
        if (const std::string differs = difference(step.description, first); !differs.empty()) {
            throw Error(ErrorKind::invalid_argument, {step.name()},
                        fmt::format("does not fit into a series with {}: {}", of, differs));
        }
    }
}

/// A digest of the first, the middle and the last plane; of a stream, only of the first plane.
std::uint64_t digest_of_planes(VolumeSource& volume) {
    const VolumeDescription d = volume.describe();
    const std::uint64_t row = static_cast<std::uint64_t>(d.nodes.x) * size_of(d.type);
    constexpr std::uint64_t kPart = std::uint64_t{1} << 20U;
    const auto rows = static_cast<std::int64_t>(std::max<std::uint64_t>(kPart / row, 1));
    std::vector<std::byte> part(
        static_cast<std::size_t>(row * static_cast<std::uint64_t>(std::min(rows, d.nodes.y))));
    std::set<std::int64_t> planes{0};
    if (!volume.sequential()) {
        planes.insert({d.nodes.z / 2, d.nodes.z - 1});
    }
    Checksum digest;
    for (const std::int64_t z : planes) {
        for (std::int64_t y = 0; y < d.nodes.y; y += rows) {
            const std::int64_t ny = std::min(rows, d.nodes.y - y);
            volume.read(z, 1, y, ny, part.data());
            digest.add(std::span(part).first(
                static_cast<std::size_t>(row * static_cast<std::uint64_t>(ny))));
        }
    }
    return digest.value();
}

/// Identifies the input: a file that is one step by its state; one of several steps in a file by
/// its values, since more steps may be added to the file.
std::string source_of(const PreprocessArguments& a, const StepInput& step, Progress& progress) {
    const std::unique_ptr<VolumeSource> volume = open_step(a, step, progress);
    const std::string identity = step.at ? std::string() : volume->identity();
    return identity.empty()
               ? fmt::format("planes:{:016x}", digest_of_planes(*volume))
               : fmt::format("file:{:016x}", checksum_of(std::as_bytes(std::span(identity))));
}

/// Decides which steps of the input are already in the series.
class KnownSteps {
  public:
    KnownSteps(const Series& series, TimeOrigin origin)
        : steps_(series.steps()), used_(steps_.size(), false), origin_(origin) {}

    /// Whether the series has this step. Sets its time if times are counted: they continue after
    /// the last one. Throws Error{invalid_argument} if the series has another step at this time.
    bool has(StepInput& step, const std::string& source, double last) {
        if (origin_ == TimeOrigin::counted && !step.at) {
            for (std::size_t i = 0; i < steps_.size(); ++i) {
                if (!used_[i] && steps_[i].source == source) {
                    step.time = steps_[i].time;
                    return used_[i] = true;
                }
            }
            step.time = steps_.empty() ? step.time : std::floor(last) + 1;
            return false;
        }
        const auto same = std::find_if(steps_.begin(), steps_.end(),
                                       [&](const SeriesStep& s) { return s.time == step.time; });
        if (same == steps_.end()) {
            return false;
        }
        if (same->source != source) {
            throw Error(
                ErrorKind::invalid_argument, {step.name()},
                fmt::format("the series already has another step at its time, {}: {} was made from "
                            "another input, or from this one before it changed",
                            time_text(step.time), same->store));
        }
        return true;
    }

  private:
    std::vector<SeriesStep> steps_;  ///< before this run
    std::vector<bool> used_;
    TimeOrigin origin_;
};

std::string plural(std::size_t count, const std::string& what) {
    return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

/// The first line, with its newline.
std::string first_line(const std::string& text) {
    return text.substr(0, std::min(text.find('\n'), text.size() - 1) + 1);
}

void require_series_options(const PreprocessArguments& a) {
    std::error_code ignored;
    if (a.preprocess.force && std::filesystem::exists(a.store, ignored)) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--force cannot replace a series; add steps to it with --append, or choose "
                    "another name for a new series");
    }
    if (std::find(a.input.begin(), a.input.end(), "-") != a.input.end()) {
        throw Error(ErrorKind::invalid_argument,
                    "--times and --append: the steps of a series are read from files, not from "
                    "standard input");
    }
    if (is_series(a.store) && !a.append) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "the series already exists; add steps to it with --append");
    }
}

/// Begins or continues the series.
SeriesWriter open_writer(const PreprocessArguments& a, const std::vector<StepInput>& steps,
                         TimeOrigin origin) {
    const std::string unit =
        origin == TimeOrigin::coordinates ? steps.front().description.time->unit : std::string();
    if (!is_series(a.store)) {
        require_same_grid(steps, steps.front().description, steps.front().name());
        return SeriesWriter::create(a.store, unit.empty() ? std::nullopt : std::optional(unit));
    }
    SeriesWriter writer = SeriesWriter::append(a.store);
    const Series& series = writer.series();
    if (!series.steps().empty()) {
        const std::filesystem::path first = series.store(0);
        require_same_grid(steps, description_of(Store(first)), first.string());
    }
    if ((origin == TimeOrigin::names || origin == TimeOrigin::counted) && series.time_unit()) {
        throw Error(
            ErrorKind::invalid_argument, {steps.front().name()},
            fmt::format("it has no time in '{}', the unit of the series; give its time with "
                        "--times",
                        *series.time_unit()));
    }
    if (origin == TimeOrigin::coordinates && !series.steps().empty() &&
        unit != series.time_unit().value_or("")) {
        throw Error(
            ErrorKind::invalid_argument, {steps.front().name()},
            fmt::format("its unit of time is '{}', but the series has '{}'; give the times in "
                        "that unit with --times",
                        unit, series.time_unit().value_or("unknown")));
    }
    return writer;
}

}  // namespace

Result preprocess_series(const PreprocessArguments& a, Progress& progress) {
    require_series_options(a);
    std::vector<StepInput> steps;
    progress.begin("opening", a.input.size(), "files");
    for (const std::string& file : a.input) {
        std::vector<StepInput> more = steps_in(a, file, progress);
        std::move(more.begin(), more.end(), std::back_inserter(steps));
        progress.advance(1);
    }
    const TimeOrigin origin = set_times(a.times, steps);
    SeriesWriter writer = open_writer(a, steps, origin);
    KnownSteps known(writer.series(), origin);
    Result result;
    Json added = Json::array();
    std::set<std::string> notes;
    std::size_t skipped = 0;
    for (std::size_t i = 0; i < steps.size(); ++i) {
        StepInput& step = steps[i];
        const auto last = [&] {
            const std::vector<SeriesStep>& all = writer.series().steps();
            return all.empty() ? -1 : all.back().time;
        };
        try {
            progress.check();
            const std::string source = source_of(a, step, progress);
            if (known.has(step, source, last())) {
                ++skipped;
                continue;
            }
            const std::size_t number = writer.series().steps().size();
            if (number > 0 && !(step.time > last())) {
                throw Error(ErrorKind::invalid_argument, {step.name()},
                            fmt::format("its time, {}, is earlier than that of the last step, {}; "
                                        "steps have to be added in the order of their times",
                                        time_text(step.time), time_text(last())));
            }
            PreprocessArguments own = arguments_of(a, step);
            own.store = writer.next_store().string();
            own.preprocess.force = true;
            StepProgress own_progress(progress, i, steps.size());
            Result made = preprocess_volume(own, nullptr, own_progress);
            writer.add(step.time, source);
            for (const Json& note : made.json["notes"]) {
                notes.insert(note.get<std::string>());
            }
            result.text += fmt::format("step {}, time {}: {}", number, time_text(step.time),
                                       first_line(made.text));
            add_warnings(made.warning, result);
            Json json{{"step", number}, {"time", step.time}, {"input", step.name()}};
            json.update(made.json);
            added.push_back(std::move(json));
        } catch (const Error& error) {
            if (writer.series().steps().empty()) {
                throw;
            }
            throw Error(
                error.kind(), error.place(),
                fmt::format("{}; {} complete in {}; --append adds the others", error.problem(),
                            writer.series().steps().size() == 1
                                ? "1 step is"
                                : plural(writer.series().steps().size(), "step") + " are",
                            writer.series().folder().string()),
                error.remedies());
        }
    }
    const Series& series = writer.series();
    result.json = series_json(series);
    result.json["times_from"] = text_of(origin);
    result.json["skipped"] = skipped;
    result.json["steps"] = std::move(added);
    result.text += fmt::format(
        "{}: {}, times {} to {}{}; the times are {}{}\n", series.folder().string(),
        plural(series.steps().size(), "step"), time_text(series.steps().front().time),
        time_text(series.steps().back().time), time_suffix(series.time_unit()), text_of(origin),
        skipped > 0 ? fmt::format("; {} already there",
                                  plural(skipped, "step") + (skipped == 1 ? " was" : " were"))
                    : "");
    for (const std::string& note : notes) {
        result.text += fmt::format("note: {}\n", note);
    }
    return result;
}

}  // namespace isonest::detail::cli
