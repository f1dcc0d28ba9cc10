// Error messages for users: remedies of the library become options of the command.
#pragma once

#include <functional>
#include <string>

#include <isonest/error.h>

#include "tools/cli/terminal/histogram_report.h"

namespace isonest::detail::cli {

/// Whether the command has an option of this name ("--memory").
using HasOption = std::function<bool(const std::string& option)>;

/// The name of the enumerator, "more_memory", for programs.
std::string name_of(RemedyKind kind);
/// The name of the enumerator, "corrupt"; "internal" if the value is not an enumerator.
std::string name_of(ErrorKind kind);

/// "give at least --memory 48M"; does not name the option if the command does not have it.
std::string text_of(const Remedy& remedy, const HasOption& has);

/// what() followed by the remedies: "s.isonest: exists; give --force to replace it or give another
/// name".
std::string message_of(const Error& error, const HasOption& has);

/// {"kind", "message", "file", "inside", "remedies": [{"kind", "value", "text"}]}
Json json_of(const Error& error, const HasOption& has);

}  // namespace isonest::detail::cli
