// The table of all options: their group, the form of their value, their line in the help, and their
// argument in Python.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <vector>

namespace isonest::detail::cli {

/// The groups of the help, in order.
inline constexpr const char* kWhat = "What";
inline constexpr const char* kHowClose = "How close";
inline constexpr const char* kWhichParts = "Which parts";
inline constexpr const char* kWritten = "What is written";
inline constexpr const char* kPicture = "The picture";
inline constexpr const char* kServer = "The server";
/// The options for reading volumes. given_source_option() finds them by this group.
inline constexpr const char* kReading = "How to read INPUT";
inline constexpr const char* kNetwork = "INPUT at a URL";
inline constexpr const char* kLimits = "Limits";
inline constexpr const char* kGeneral = "General";

std::span<const char* const> option_groups();

/// Sets group, form and description of every option of the command. Throws std::logic_error for an
/// option that is not in the table.
void describe_options(CLI::App& command);

/// The options of the command that belong to this group, in the order of the table.
std::vector<const CLI::Option*> options_in(const CLI::App& command, const char* group);

/// All options and positional arguments of the command, after describe_options(): for each the
/// `name`, the form of its `value`, its `text`, whether it is `required`, its `group`, and in
/// `python` the `argument` and its `type`, or in `none` why there is no argument.
nlohmann::ordered_json options_json(const CLI::App& command);

}  // namespace isonest::detail::cli
