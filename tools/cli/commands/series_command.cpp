#include "tools/cli/commands/series_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <utility>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/surface_options.h"

namespace isonest::detail::cli {

void StepProgress::begin(std::string_view phase, std::uint64_t total, std::string_view unit) {
    whole_.begin(fmt::format("step {} of {}: {}", step_ + 1, steps_, phase), total, unit);
}

std::optional<Series> open_if_series(const InputArguments& a, const Communicator* ranks) {
    if (a.input.size() != 1 || !is_series(a.input.front())) {
        return std::nullopt;
    }
    const std::string& name = a.input.front();
    require_no_source_option(a.source_option, name);
    if (ranks != nullptr) {
        require_no_series(name);
    }
    return Series(name);
}

Json series_json(const Series& series) {
    return {{"series", series.folder().string()},
            {"time_unit", series.time_unit() ? Json(*series.time_unit()) : Json()}};
}

void require_same_place(const Store& first, const Store& other) {
    const UnevenAxesPtr uneven = first.uneven_axes();
    const UnevenAxesPtr others = other.uneven_axes();
    const bool same_axes =
        (uneven == nullptr) == (others == nullptr) && (uneven == nullptr || *uneven == *others);
    if (!same_axes || (first.curved() == nullptr) != (other.curved() == nullptr) ||
        !(other.nodes() == first.nodes()) || other.type() != first.type() ||
        other.spacing() != first.spacing() || other.origin() != first.origin() ||
        other.direction() != first.direction()) {
        throw Error(ErrorKind::corrupt, {other.path().string()},
                    fmt::format("has other nodes, another place or another type than the first "
                                "step of the series, {}",
                                first.path().filename().string()));
    }
}

void add_warnings(const std::string& warning, Result& result) {
    std::istringstream lines(warning);
    for (std::string line; std::getline(lines, line);) {
        if (("\n" + result.warning + "\n").find("\n" + line + "\n") == std::string::npos) {
            result.warning += (result.warning.empty() ? "" : "\n") + line;
        }
    }
}

Result run_on_steps(const Series& series, const std::vector<std::size_t>& steps, Progress& progress,
                    const RunStep& run) {
    Result all;
    all.json = series_json(series);
    all.json["steps"] = Json::array();
    for (std::size_t i = 0; i < steps.size(); ++i) {
        const std::size_t step = steps[i];
        const double time = series.steps()[step].time;
        progress.check();
        StepProgress own(progress, i, steps.size());
        Result result = run(step, own);
        Json json{{"step", step}, {"time", time}};
        json.update(result.json);
        all.json["steps"].push_back(std::move(json));
        all.text += fmt::format("step {}, time {}: {}", step, time_text(time), result.text);
        add_warnings(result.warning, all);
        all.exit_code = std::max(all.exit_code, result.exit_code);
    }
    return all;
}

Result write_steps(const Series& series, const std::string& times, const std::string& name,
                   const std::vector<std::string>& isovalues, Progress& progress,
                   const WriteStep& run) {
    require_place_for_step(name);
    const std::vector<std::size_t> steps = chosen_steps(series, times);
    // One index for all files; with {iso}, one for each isovalue.
    std::vector<std::pair<StepsIndex, std::string>> indexes;
    const std::vector<std::string> texts =
        is_own_name(name) && !isovalues.empty() ? isovalues : std::vector<std::string>{""};
    for (const std::string& text : texts) {
        const std::string own = text.empty() ? name : mesh_name(name, text);
        if (std::optional<StepsIndex> index = index_of(own, series)) {
            check_output(index->name, true, {});
            indexes.emplace_back(std::move(*index), own);
        }
    }
    Result result =
        run_on_steps(series, steps, progress, [&](std::size_t step, Progress& step_progress) {
            return run(series.store(step).string(), name_of_step(name, series, step),
                       step_progress);
        });
    result.json["index"] = Json::array();
    for (auto& [index, own] : indexes) {
        for (const std::size_t step : steps) {
            const std::filesystem::path file(name_of_step(own, series, step));
            index.entries.push_back({series.steps()[step].time, file.filename().string()});
        }
        write_index(index);
        result.json["index"].push_back(index.name.string());
        result.text += fmt::format("{}: index of {} meshes for ParaView\n", index.name.string(),
                                   index.entries.size());
    }
    return result;
}

}  // namespace isonest::detail::cli
