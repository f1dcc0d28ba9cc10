// Labels by their names, and what is said of them.
#pragma once

#include <cstdint>
#include <string>

#include <isonest/mesh_file.h>
#include <isonest/store.h>

#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// "12", "-3", "3-7": a number, or a range of numbers, and no name.
bool is_label_range(const std::string& text);

/// The label that is called so. Throws Error{not_found}, which names the nearest names, and
/// Error{invalid_argument} where several are called so.
std::int64_t label_named(const Store& store, const std::string& name);

/// A mesh of this label, with its name and colour; an existing file is replaced.
MeshFileOptions label_file_options(const Store& store, std::int64_t id, MeshSpace space);

/// Adds "name" and "color", as far as they are known.
void add_label_name(const Store& store, std::int64_t id, Json& json);

/// " (liver)", or nothing.
std::string label_name_text(const Store& store, std::int64_t id);

}  // namespace isonest::detail::cli
