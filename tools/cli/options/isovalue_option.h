// The option that gives one isovalue or several, and the names of their meshes.
#pragma once

#include <string>
#include <vector>

#include "tools/cli/command.h"

namespace isonest::detail::cli {

struct Isovalues {
    std::vector<double> all;
    std::vector<std::string> texts;  ///< as they were given

    /// The first; 0 if none was given.
    [[nodiscard]] double one() const { return all.empty() ? 0 : all.front(); }
};

/// Adds --iso.
CLI::Option* add_isovalue_option(CLI::App* command, Isovalues& isovalues);

/// `mesh` with the isovalue's text in place of each {iso}.
std::string mesh_name(std::string mesh, const std::string& iso);

/// Whether the name differs with the isovalue.
bool is_own_name(const std::string& mesh);

/// Throws Error{invalid_argument} unless the format that the name chooses keeps the isovalue of
/// each vertex.
void require_place_for_isovalue(const std::string& mesh);

}  // namespace isonest::detail::cli
