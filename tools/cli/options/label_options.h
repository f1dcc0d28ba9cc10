// The options of extract that ask for labels in place of an isovalue.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract.h>

#include "tools/cli/command.h"
#include "tools/cli/options/extract_options.h"

namespace isonest::detail::cli {

struct LabelArguments {
    std::optional<std::int64_t> one;
    /// Ranges, both ends included; empty: all but 0.
    std::optional<std::vector<std::pair<std::int64_t, std::int64_t>>> several;
    std::string format = "ply";
};

/// --label, --labels, --format. The first two exclude all of `others`.
void add_label_options(CLI::App* command, LabelArguments& a,
                       const std::vector<std::string>& others);

/// Writes a mesh for each of the labels, and the file labels.json, into the folder a.mesh.
/// REQUIRES: labels.several.
Result extract_label_meshes(const Store& store, const LabelArguments& labels,
                            const ExtractArguments& a, const LabelQuery& query, Progress& progress);

}  // namespace isonest::detail::cli
