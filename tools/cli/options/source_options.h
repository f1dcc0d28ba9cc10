// The options that say how to read an input volume.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/open_volume.h>

namespace isonest::detail::cli {

/// Inverse of name_of(ValueType) for --type. Throws Error{invalid_argument}.
ValueType parse_type(const std::string& text);

/// A vector of files (slices), a folder, a file, or "-" for standard input, which is copied to
/// `scratch_folder` first.
std::unique_ptr<VolumeSource> open_input(const std::vector<std::string>& input,
                                         const std::filesystem::path& scratch_folder,
                                         const SourceOptions& options);

/// --dataset, --series, --index, --crop, --every, --dims, --type, --endian, --offset, --spacing,
/// --origin, --missing and, unless a command has another option of that name, --labels.
void add_source_options(CLI::App* command, SourceOptions& options, bool with_labels = true);
/// "--dataset": one of them that was given; or empty.
std::string given_source_option(const CLI::App& command);
/// Throws Error{invalid_argument} where one was given for this store. `option`: it, or empty.
void require_no_source_option(const std::string& option, const std::string& store);

}  // namespace isonest::detail::cli
