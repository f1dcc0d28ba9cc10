// The help of the commands, in lines of at most 80 characters.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace isonest::detail::cli {

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
    std::string make_description(const CLI::App* app) const override;
};

}  // namespace isonest::detail::cli
