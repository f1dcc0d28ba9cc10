// Commands on a series: each runs the command for one store on every step.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <isonest/progress.h>
#include <isonest/series.h>
#include <isonest/store.h>

#include "tools/cli/commands/input_store.h"
#include "tools/cli/options/series_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

/// The series that INPUT names; nullopt if it is something else. Throws what Series throws, and
/// Error{invalid_argument} for options that only volumes have, or if `ranks` is not null.
std::optional<Series> open_if_series(const InputArguments& a, const Communicator* ranks);

/// Runs `run` for each of the steps, in their order, and collects the reports in "steps" and the
/// warnings, each once. The exit code is the largest.
using RunStep = std::function<Result(std::size_t step, Progress& progress)>;
Result run_on_steps(const Series& series, const std::vector<std::size_t>& steps, Progress& progress,
                    const RunStep& run);

/// Like run_on_steps(), for commands that write files: `name` has {time} or {step}, and `run`
/// writes the file that it is given. At the end, writes the index for ParaView, if the format has
/// one. `isovalues`: as on the command line, for {iso} in `name`; empty if there are none.
using WriteStep =
    std::function<Result(const std::string& store, const std::string& file, Progress& progress)>;
Result write_steps(const Series& series, const std::string& times, const std::string& name,
                   const std::vector<std::string>& isovalues, Progress& progress,
                   const WriteStep& run);

/// The members of the JSON report that all commands on a series have.
Json series_json(const Series& series);
/// For what takes lattice, place and type of all steps from the first one: throws Error{corrupt} if
/// another step's store differs.
void require_same_place(const Store& first, const Store& other);
/// Adds each line of `warning` that is not there yet.
void add_warnings(const std::string& warning, Result& result);

/// Progress of one of several steps: "step 3 of 12: extracting". Thread-safety: as Progress.
class StepProgress : public Progress {
  public:
    StepProgress(Progress& whole, std::size_t step, std::size_t steps)
        : whole_(whole), step_(step), steps_(steps) {}
    void begin(std::string_view phase, std::uint64_t total, std::string_view unit) override;
    void advance(std::uint64_t amount) override { whole_.advance(amount); }
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    Progress& whole_;
    std::size_t step_;
    std::size_t steps_;
};

}  // namespace isonest::detail::cli
