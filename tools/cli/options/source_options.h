// The options for reading an input volume.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/open_volume.h>

namespace isonest::detail::cli {

/// The parts of a text that is split at each character `at`; at least one part.
std::vector<std::string> items_of(const std::string& text, char at);

/// Parses the value of --type; the inverse of name_of(ValueType). Throws Error{invalid_argument}.
ValueType parse_type(const std::string& text);

/// Opens files (slices), a folder, a file, or standard input ("-"), which is first copied to
/// `scratch_folder`. Throws what open_volume() throws.
std::unique_ptr<VolumeSource> open_input(const std::vector<std::string>& input,
                                         const std::filesystem::path& scratch_folder,
                                         const SourceOptions& options);

/// Adds --dataset, --series, --index, --crop, --every, --periodic, --repeat, --dims, --type,
/// --endian, --offset,
/// --spacing, --origin, --missing and, if `with_labels`, --labels (some commands have another
/// option of that name).
void add_source_options(CLI::App* command, SourceOptions& options, bool with_labels = true);
/// The name of one of these options that was given ("--dataset"), or empty.
std::string given_source_option(const CLI::App& command);
/// Throws Error{invalid_argument} if `option`, one of these, is not empty: `store` is a store, not
/// a volume.
void require_no_source_option(const std::string& option, const std::string& store);

}  // namespace isonest::detail::cli
