// What an error says to the user: the library's remedies as options of the command at hand.
#pragma once

#include <functional>
#include <string>

#include <isonest/error.h>

#include "tools/cli/terminal/histogram_report.h"

namespace isonest::detail::cli {

/// Whether the command at hand has an option of this name ("--memory").
using HasOption = std::function<bool(const std::string& option)>;

/// "more_memory": the name of the enumerator, for programs.
std::string name_of(RemedyKind kind);
/// "corrupt"; "internal" for what is no ErrorKind.
std::string name_of(ErrorKind kind);

/// "give at least --memory 48M"; without the name of the option where the command has none.
std::string text_of(const Remedy& remedy, const HasOption& has);

/// what(), and behind it the remedies: "s.isonest: exists; give --force to replace it or give
/// another name".
std::string message_of(const Error& error, const HasOption& has);

/// {"kind", "message", "file", "inside", "remedies": [{"kind", "value", "text"}]}
Json json_of(const Error& error, const HasOption& has);

}  // namespace isonest::detail::cli
