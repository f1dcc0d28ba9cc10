#include "tools/cli/options/series_options.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>

#include <isonest/error.h>

#include "store/base/escaped_text.h"
#include "store/files/output_file.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

constexpr const char* kOption = "--times";
constexpr std::string_view kTime = "{time}";
constexpr std::string_view kStep = "{step}";
/// Times are compared with this tolerance, since sums of steps are not exact in binary.
constexpr double kRounding = 1e-9;

std::optional<double> number_in(const std::string& text) {
    return text.empty() ? std::nullopt : std::optional(parse_number(kOption, text));
}

struct TimeRange {
    std::optional<double> start;
    std::optional<double> stop;
    std::optional<double> step;
};

/// "START:STOP" or "START:STOP:STEP"; none if the text has no colon.
std::optional<TimeRange> range_in(const std::string& text) {
    const std::vector<std::string> parts = items_of(text, ':');
    if (parts.size() == 1) {
        return std::nullopt;
    }
    TimeRange range;
    range.start = number_in(parts[0]);
    range.stop = number_in(parts[1]);
    if (parts.size() > 2) {
        range.step = number_in(parts[2]);
    }
    if (parts.size() > 3 || (range.step && !(*range.step > 0)) ||
        (range.start && range.stop && !(*range.start <= *range.stop))) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give START:STOP:STEP with START <= STOP and STEP > 0",
                                kOption, text));
    }
    return range;
}

std::vector<double> numbers_in(const std::string& text) {
    std::vector<double> numbers;
    for (const std::string& part : items_of(text, ',')) {
        numbers.push_back(parse_number(kOption, part));
    }
    return numbers;
}

/// How far a time given as text may be from that of a step: what decimal digits round, and far less
/// than the distance between steps.
double slack_of(const std::vector<SeriesStep>& steps, double time) {
    constexpr double kOfDistance = 1e-3;
    double slack = kRounding * std::fabs(time);
    for (std::size_t i = 1; i < steps.size(); ++i) {
        slack = std::min(slack, kOfDistance * (steps[i].time - steps[i - 1].time));
    }
    return slack;
}

}  // namespace

NewTimes parse_new_times(const std::string& text) {
    NewTimes times;
    if (text == "auto") {
        return times;
    }
    times.from_input = false;
    if (const std::optional<TimeRange> range = range_in(text)) {
        times.start = range->start.value_or(0);
        times.step = range->step.value_or(1);
        times.stop = range->stop;
        if (times.stop && *times.stop < times.start) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("{} '{}': the end is before the start", kOption, text));
        }
        return times;
    }
    times.all = numbers_in(text);
    if (std::adjacent_find(times.all.begin(), times.all.end(), std::greater_equal<>()) !=
        times.all.end()) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{} '{}': the times have to ascend, in the order of INPUT", kOption, text));
    }
    return times;
}

std::vector<double> times_of(const NewTimes& times, std::size_t steps) {
    std::vector<double> all = times.all;
    std::size_t given = all.size();
    if (all.empty()) {
        for (std::size_t i = 0; i < steps; ++i) {
            all.push_back(times.start + static_cast<double>(i) * times.step);
        }
        given = steps;
        if (times.stop) {
            const double more = (*times.stop - times.start) / times.step + kRounding;
            constexpr double kMax = 1e9;
            if (!(more < kMax)) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("{} gives more than {:.0f} times", kOption, kMax));
            }
            given = static_cast<std::size_t>(more) + 1;
        }
    }
    if (std::adjacent_find(all.begin(), all.end(), std::greater_equal<>()) != all.end()) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{}: the interval is so small that successive times are the same number",
                        kOption));
    }
    if (given != steps) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} gives {} time{}, but there are {} steps", kOption, given,
                                given == 1 ? "" : "s", steps));
    }
    return all;
}

std::vector<std::size_t> chosen_steps(const Series& series, const std::string& text) {
    const std::vector<SeriesStep>& steps = series.steps();
    if (steps.empty()) {
        throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                    "the series has no steps yet");
    }
    std::vector<std::size_t> chosen;
    if (text.empty()) {
        for (std::size_t i = 0; i < steps.size(); ++i) {
            chosen.push_back(i);
        }
        return chosen;
    }
    if (const std::optional<TimeRange> range = range_in(text)) {
        const double start = range->start.value_or(steps.front().time);
        const double length = range->step.value_or(0);
        const double slack = slack_of(steps, start);
        double from = start;  // of the interval whose first step is chosen
        for (std::size_t i = 0; i < steps.size(); ++i) {
            const double time = steps[i].time;
            if (time < from - slack ||
                (range->stop && time > *range->stop + slack_of(steps, *range->stop))) {
                continue;
            }
            chosen.push_back(i);
            if (length > 0) {
                from = start + (std::floor((time - start) / length + kRounding) + 1) * length;
            }
        }
    } else {
        for (const double wanted : numbers_in(text)) {
            const auto nearest =
                std::min_element(steps.begin(), steps.end(), [&](const auto& a, const auto& b) {
                    return std::fabs(a.time - wanted) < std::fabs(b.time - wanted);
                });
            if (std::fabs(nearest->time - wanted) > slack_of(steps, wanted)) {
                throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                            fmt::format("{}: there is no step at {}; the nearest is at {}", kOption,
                                        time_text(wanted), time_text(nearest->time)));
            }
            chosen.push_back(static_cast<std::size_t>(nearest - steps.begin()));
        }
        std::sort(chosen.begin(), chosen.end());
        chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
    }
    if (chosen.empty()) {
        throw Error(ErrorKind::invalid_argument, {series.folder().string()},
                    fmt::format("{} '{}' selects no step; the times are {} to {}", kOption, text,
                                time_text(steps.front().time), time_text(steps.back().time)));
    }
    return chosen;
}

void require_no_times(const std::string& text, const std::string& input) {
    if (!text.empty()) {
        throw Error(ErrorKind::invalid_argument, {input},
                    fmt::format("{} selects steps of a series, but this is not a series", kOption));
    }
}

std::string time_text(double time) {
    return fmt::format("{}", time);
}

std::string time_suffix(const std::optional<std::string>& unit) {
    return unit && !unit->empty() ? " " + *unit : "";
}

namespace {

/// Replaces each occurrence of `place`.
void replace_all(std::string& text, std::string_view place, const std::string& by) {
    for (std::size_t at = text.find(place); at != std::string::npos;
         at = text.find(place, at + by.size())) {
        text.replace(at, place.size(), by);
    }
}

/// Removes each occurrence with the separator before it or, at the start of a name, the one after.
void remove_all(std::string& name, std::string_view place) {
    constexpr std::string_view kSeparators = "_-. ";
    for (std::size_t at = name.find(place); at != std::string::npos; at = name.find(place)) {
        name.erase(at, place.size());
        if (at > 0 && kSeparators.find(name[at - 1]) != std::string_view::npos) {
            name.erase(at - 1, 1);
        } else if (at == 0 && name.size() > 1 && name[0] != '.' &&
                   kSeparators.find(name[0]) != std::string_view::npos) {
            name.erase(0, 1);
        }
    }
}

bool has_place(const std::string& name) {
    return name.find(kTime) != std::string::npos || name.find(kStep) != std::string::npos;
}

}  // namespace

std::string name_of_step(const std::string& name, const Series& series, std::size_t step) {
    std::string own = name;
    replace_all(own, kTime, time_text(series.steps().at(step).time));
    replace_all(own, kStep, fmt::format("{:06}", step));
    return own;
}

void require_place_for_step(const std::string& name) {
    const std::filesystem::path path(name);
    const std::string file = path.filename().string();
    if (has_place(path.parent_path().string())) {
        throw Error(
            ErrorKind::invalid_argument, {name},
            "{time} and {step} have to be in the name of the file, not in that of its folder");
    }
    if (!has_place(file)) {
        const std::string end = path.extension().string();
        const std::string stem = path.stem().string();
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("a series needs a file for each step: put {{time}} or {{step}} "
                                "into the name, as in -o {}",
                                (path.parent_path() / (stem + "_{time}" + end)).string()));
    }
}

std::optional<StepsIndex> index_of(const std::string& name, const Series& series) {
    const std::filesystem::path path(name);
    const std::string end = lower_extension(path);
    constexpr std::array<std::string_view, 5> kOfSeries{".ply", ".stl", ".obj", ".glb", ".vtkhdf"};
    const bool in_xml = end == ".vtp";
    if (!in_xml && std::find(kOfSeries.begin(), kOfSeries.end(), end) == kOfSeries.end()) {
        return std::nullopt;
    }
    std::string stem = path.stem().string();
    remove_all(stem, kTime);
    remove_all(stem, kStep);
    if (stem.empty()) {
        stem = series.folder().stem().string();
    }
    return StepsIndex{path.parent_path() /
                      (stem + (in_xml ? ".pvd" : path.extension().string() + ".series"))};
}

void write_index(const StepsIndex& index) {
    std::string text;
    if (index.name.extension() == ".pvd") {
        text =
            "<?xml version=\"1.0\"?>\n"
            "<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
            " <Collection>\n";
        for (const StepsIndex::Entry& entry : index.entries) {
            text += fmt::format("  <DataSet timestep=\"{}\" part=\"0\" file=\"{}\"/>\n",
                                time_text(entry.time), in_markup(entry.file));
        }
        text += " </Collection>\n</VTKFile>\n";
    } else {
        nlohmann::ordered_json json{{"file-series-version", "1.0"},
                                    {"files", nlohmann::ordered_json::array()}};
        for (const StepsIndex::Entry& entry : index.entries) {
            json["files"].push_back({{"name", entry.file}, {"time", entry.time}});
        }
        text = json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
    }
    AppendedFile file(index.name);
    file.add(std::as_bytes(std::span(text)));
    file.publish();
}

}  // namespace isonest::detail::cli
