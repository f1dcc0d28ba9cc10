// What is wrong with a command line that cannot be run, and what was probably meant.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

namespace isonest::detail::cli {

struct Program;

/// A value that was written with a blank or without a comma: "unexpected 'mm'; write --distance
/// 0.5mm". Words that are files are never meant. Nothing if there is none.
std::optional<std::string> stray_word(const CLI::App& command, int argc, char** argv);

/// What `error` means to who wrote the command line: an unknown command or option and the one that
/// may be meant, a stray word, what is missing and what it can be, options that cannot be combined.
std::string parse_message(const Program& program, const CLI::App& app, const CLI::ParseError& error,
                          int argc, char** argv);

}  // namespace isonest::detail::cli
