// The options for series: times, and a file name for each step.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <isonest/series.h>

namespace isonest::detail::cli {

// The times of new steps: --times of preprocess.

struct NewTimes {
    bool from_input = true;      ///< "auto"
    std::vector<double> all{};   ///< ascending; for "T,T,..."
    double start = 0;            ///< for "START:STOP:STEP", without `all`
    double step = 1;             ///< > 0
    std::optional<double> stop;  ///< the last time, at most
};
/// Throws Error{invalid_argument}.
NewTimes parse_new_times(const std::string& text);
/// One time for each of `steps` steps. REQUIRES: not from_input. Throws Error{invalid_argument} if
/// their numbers differ.
std::vector<double> times_of(const NewTimes& times, std::size_t steps);

// The choice of steps: --times of commands that read a series.

/// The numbers of the steps that `text` selects: "T,T,..." these times, "START:STOP" all from START
/// to STOP, "START:STOP:STEP" the first of those in each interval that begins at START, START +
/// STEP, START + 2 STEP, ...; START and STOP may be empty. An empty text selects all. Throws
/// Error{invalid_argument} for other texts, times that do not occur (naming the nearest one), and
/// if nothing is selected.
std::vector<std::size_t> chosen_steps(const Series& series, const std::string& text);
/// For an INPUT that is not a series: throws Error{invalid_argument} unless `text` (--times) is
/// empty.
void require_no_times(const std::string& text, const std::string& input);

/// "3", "0.25": the fewest digits that read back as the same number.
std::string time_text(double time);
/// " s" or "", to append to a time.
std::string time_suffix(const std::optional<std::string>& unit);

// The files of the steps.

/// The name of a step's file: {time} and {step} in `name` are replaced by the step's time and its
/// number in six digits. A name without them is returned unchanged.
std::string name_of_step(const std::string& name, const Series& series, std::size_t step);
/// Throws Error{invalid_argument} unless {time} or {step} is in the file name, and in no folder.
void require_place_for_step(const std::string& name);

/// A file that ParaView opens instead of the files of all steps.
struct StepsIndex {
    std::filesystem::path name;  ///< "s.pvd" for s_{time}.vtp, "s.ply.series" for s_{time}.ply
    struct Entry {
        double time;
        std::string file;  ///< in the folder of the index
    };
    std::vector<Entry> entries = {};
};
/// The index for files with this name, which has {time} or {step}; none if ParaView has no such
/// index for their format. `series`: for a file name that is nothing but {time}.
std::optional<StepsIndex> index_of(const std::string& name, const Series& series);
/// Writes the index, replacing an existing one. Throws what OutputFile throws.
void write_index(const StepsIndex& index);

}  // namespace isonest::detail::cli
