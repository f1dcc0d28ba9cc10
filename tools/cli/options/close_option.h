// The option that closes a surface, and what a report says of it.
#pragma once

#include <optional>
#include <string>

#include <isonest/extract.h>

#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// Adds --close. `close` stays empty unless it is given.
CLI::Option* add_close_option(CLI::App* command, std::optional<Outside>& close);

/// "closed at the faces of the volume". `has_box`: a box was asked for.
std::string close_text(const ClosingReport& r, bool has_box);
/// Adds what a report has of it.
void add_close_json(const ClosingReport& r, Json& json);

}  // namespace isonest::detail::cli
