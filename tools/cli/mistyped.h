// Explains command lines that cannot be parsed, and suggests corrections.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

namespace isonest::detail::cli {

struct Program;

/// Finds a value that was split by a blank or lacks a comma, and suggests the correction:
/// "unexpected 'mm'; write --distance 0.5mm". Words that are existing files are not considered.
/// Nothing if there is no such value.
std::optional<std::string> stray_word(const CLI::App& command, int argc, char** argv);

/// The message for a parse error: an unknown command or option with the nearest name, a stray word,
/// missing options with their meaning, or options that cannot be combined.
std::string parse_message(const Program& program, const CLI::App& app, const CLI::ParseError& error,
                          int argc, char** argv);

}  // namespace isonest::detail::cli
