// Text on a terminal: escaping, suggestions for mistyped names, and the format of the help.
#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail::cli {

// Untrusted text on a terminal.

/// Escapes (as \x1b) everything in the text that could move the cursor, change colours or affect
/// the terminal: control characters, Unicode characters that change the direction of text, and
/// bytes that are not UTF-8.
std::string shown_text(std::string_view text);
/// The same for a message or report of several lines: newlines and tabs are kept.
std::string shown_lines(std::string_view text);

// Suggestions for mistyped names.

/// The name with the smallest edit distance to `word`, if at most a third of its letters were
/// inserted, deleted, replaced, or swapped with the next one. Source: F. Damerau, "A technique for
/// computer detection and correction of spelling errors", CACM 7 (1964).
std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names);

/// Up to `most` such names, nearest first.
std::vector<std::string> nearest_names(const std::string& word,
                                       const std::vector<std::string>& names, std::size_t most);

// The help of the commands, in lines of at most 80 characters.

inline constexpr std::size_t kHelpColumns = 80;

/// Wraps the text. The first line begins after `column` characters that are already written, the
/// others are indented by `indent`. Words are not broken, and empty lines are kept.
std::string wrapped(const std::string& text, std::size_t column, std::size_t indent);

/// Names and values of options on the left, descriptions on the right. Exclusions and requirements
/// are not listed; error messages explain them.
class HelpFormat : public CLI::Formatter {
  public:
    /// In the help of the program: the summary of each command.
    std::string make_subcommand(const CLI::App* command) const override;
    std::string make_option(const CLI::Option* option, bool is_positional) const override;
    /// In the help of a command: the groups of the table of options, in order.
    std::string make_help(const CLI::App* app, std::string name,
                          CLI::AppFormatMode mode) const override;
    std::string make_description(const CLI::App* app) const override;
};

// Stores in other programs.

/// For the help: the readers with which ParaView opens a store, and the folder of the HDF5 filter
/// that they need. Sources: ParaView's readers_iohdf.xml (5.12 and later: vtkhdf, hdf), and the
/// documentation of VTKHDFReader of 5.11 (hdf).
std::string paraview_hint();

}  // namespace isonest::detail::cli
