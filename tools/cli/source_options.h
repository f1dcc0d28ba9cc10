// The options that say how to read an input volume.
#pragma once

#include <CLI/CLI.hpp>

#include <isonest/open_volume.h>

namespace isonest::detail::cli {

/// Inverse of name_of(ValueType) for --type. Throws Error{invalid_argument}.
ValueType parse_type(const std::string& text);

/// --dataset, --dims, --type, --endian, --offset, --spacing, --origin.
void add_source_options(CLI::App* command, SourceOptions& options);

}  // namespace isonest::detail::cli
