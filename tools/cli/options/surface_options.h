// Options for surfaces: closing, components, isovalues, distance and number of triangles.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>

#include "tools/cli/options/units.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

// --close, and its report.

/// Adds --close. `close` stays empty unless the option is given.
CLI::Option* add_close_option(CLI::App* command, std::optional<Outside>& close);

/// "closed at the faces of the volume". `has_box`: --box was given.
std::string close_text(const ClosingReport& r, bool has_box);
/// Adds the members of a report on closing.
void add_close_json(const ClosingReport& r, Json& json);

// The options that drop components of a surface, and their report.

/// Adds and returns --components, --min-component and --min-volume. `choice` stays empty unless one
/// of them is given.
std::vector<CLI::Option*> add_component_options(CLI::App* command,
                                                std::optional<ComponentChoice>& choice);

/// "dropped 37 of 40 components with 412 triangles, the largest of 38". REQUIRES: r.components.
std::string component_text(const ExtractReport& r);
/// Adds the members of a report on components.
void add_component_json(const ComponentReport& r, Json& json);

// --iso, and the names of the meshes of several isovalues.

struct Isovalues {
    std::vector<double> all;
    std::vector<std::string> texts;  ///< as given

    /// The first isovalue; 0 if none was given.
    [[nodiscard]] double one() const { return all.empty() ? 0 : all.front(); }
};

CLI::Option* add_isovalue_option(CLI::App* command, Isovalues& isovalues);

/// `mesh` with the isovalue's text in place of each {iso}.
std::string mesh_name(std::string mesh, const std::string& iso);

/// Whether the name contains {iso}.
bool is_own_name(const std::string& mesh);

/// Throws Error{invalid_argument} unless the format of this mesh file can store an isovalue per
/// vertex.
void require_place_for_isovalue(const std::string& mesh);

// The options of extract for a distance or a number of triangles.

struct DistanceArguments {
    std::optional<DistanceBound> distance;  ///< in the unit given, until resolve() is called
    Length length;                          ///< the distance as given
    std::string unit;                       ///< appended to lengths in a report: " mm"
    std::uint64_t triangles = 0;            ///< 0: not given
    std::optional<KeptAnalysis> analysis;
    bool by_error = false;  ///< minimise the error, not the distance, for the number of triangles
    std::optional<Effort> effort;

    /// Converts the distance to the unit of the world. Throws Error{invalid_argument} if the
    /// distance has a unit but the world's is unknown. `name`: of the store or volume, for the
    /// message.
    void resolve(std::optional<LengthUnit> of_world, const std::string& name);
    /// The stop test, which replaces an error; nothing if neither option was given.
    [[nodiscard]] std::optional<SurfaceStop> stop() const;
};

/// Adds the options, which exclude all of `others`.
void add_distance_options(CLI::App* command, DistanceArguments& a,
                          const std::vector<std::string>& others);

/// "within 0.49 of the surface ... (asked for 0.5)". REQUIRES: r.distance or r.within_budget.
std::string distance_text(const DistanceArguments& a, const ExtractReport& r);
/// How a kept analysis was used, in one line; may be empty.
std::string analysis_text(const ExtractReport& r);
/// ", simplified from 1000 triangles", or empty.
std::string simplified_text(const ExtractReport& r);
/// Adds the members of the report on distance and number of triangles.
void add_distance_json(Json& json, const ExtractReport& r);

}  // namespace isonest::detail::cli
