// Words on a terminal: of others, for help, and for who mistyped.
#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail::cli {

// What others have written, for a terminal.

/// The text with what may move, colour or rename the terminal written out: control characters,
/// those of Unicode that turn the direction of text, and bytes that are no UTF-8, as \x1b.
std::string shown_text(std::string_view text);
/// The same of a message or a report, which may have several lines: ends of lines and tabs stay.
std::string shown_lines(std::string_view text);

// What somebody may have meant who mistyped a name.

/// The one of `names` that differs least from `word`: by no more than a third of its letters being
/// inserted, left out, replaced, or swapped with the next one. Source: F. Damerau, "A technique for
/// computer detection and correction of spelling errors", CACM 7 (1964).
std::optional<std::string> nearest_name(const std::string& word,
                                        const std::vector<std::string>& names);

/// Up to `most` of them that differ as little, the nearest first.
std::vector<std::string> nearest_names(const std::string& word,
                                       const std::vector<std::string>& names, std::size_t most);

// The help of the commands, in lines of at most 80 characters.

inline constexpr std::size_t kHelpColumns = 80;

/// Lines of words, the first one after `column` characters that are there already, the others
/// indented by `indent`. What is one word stays one, and an empty line stays.
std::string wrapped(const std::string& text, std::size_t column, std::size_t indent);

/// Names and values of options on the left, what they mean on the right; which options exclude or
/// need each other is left to the errors.
class HelpFormat : public CLI::Formatter {
  public:
    /// Of the whole program the first line of each command.
    std::string make_subcommand(const CLI::App* command) const override;
    std::string make_option(const CLI::Option* option, bool is_positional) const override;
    /// Of a command with the groups of the table of options, in its order.
    std::string make_help(const CLI::App* app, std::string name,
                          CLI::AppFormatMode mode) const override;
    std::string make_description(const CLI::App* app) const override;
};

// How other programs open a store.

/// For the help: under which names ParaView opens a store, and where the filter is that HDF5 needs
/// for it. Sources: ParaView's readers_iohdf.xml (5.12 and later: vtkhdf, hdf), and the
/// documentation of VTKHDFReader of 5.11 (hdf).
std::string paraview_hint();

}  // namespace isonest::detail::cli
