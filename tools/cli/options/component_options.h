// The options that drop components of a surface, and what a report says of them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>

#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// Adds --components, --min-component and --min-volume; returns them. `choice` stays empty unless
/// one of them is given.
std::vector<CLI::Option*> add_component_options(CLI::App* command,
                                                std::optional<ComponentChoice>& choice);

/// "dropped 37 of 40 components with 412 triangles, the largest of 38". REQUIRES: r.components.
std::string component_text(const ExtractReport& r);
/// Adds what a report has of components.
void add_component_json(const ComponentReport& r, Json& json);

}  // namespace isonest::detail::cli
