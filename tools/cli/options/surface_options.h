// The options that say what becomes of a surface: closed, its components, its isovalues, its
// distance.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/extract.h>

#include "tools/cli/options/units.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

// The option that closes a surface, and what a report says of it.

/// Adds --close. `close` stays empty unless it is given.
CLI::Option* add_close_option(CLI::App* command, std::optional<Outside>& close);

/// "closed at the faces of the volume". `has_box`: a box was asked for.
std::string close_text(const ClosingReport& r, bool has_box);
/// Adds what a report has of it.
void add_close_json(const ClosingReport& r, Json& json);

// The options that drop components of a surface, and what a report says of them.

/// Adds --components, --min-component and --min-volume; returns them. `choice` stays empty unless
/// one of them is given.
std::vector<CLI::Option*> add_component_options(CLI::App* command,
                                                std::optional<ComponentChoice>& choice);

/// "dropped 37 of 40 components with 412 triangles, the largest of 38". REQUIRES: r.components.
std::string component_text(const ExtractReport& r);
/// Adds what a report has of components.
void add_component_json(const ComponentReport& r, Json& json);

// The option that gives one isovalue or several, and the names of their meshes.

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

// The options of extract that ask for a distance or for a number of triangles.

struct DistanceArguments {
    std::optional<DistanceBound> distance;  ///< as given until resolve()
    Length length;                          ///< the distance as given
    std::string unit;                       ///< behind a length of a report: " mm"
    std::uint64_t triangles = 0;            ///< 0: not asked for
    std::optional<KeptAnalysis> analysis;
    bool by_error = false;  ///< the error is what the number of triangles makes small
    std::optional<Effort> effort;

    /// The distance in the unit of the world. Throws Error{invalid_argument} where that is not
    /// known but the distance was given in one. `name`: of the store or volume.
    void resolve(std::optional<LengthUnit> of_world, const std::string& name);
    /// In place of an error; nothing if neither was given.
    [[nodiscard]] std::optional<SurfaceStop> stop() const;
};

/// The options exclude all of `others`.
void add_distance_options(CLI::App* command, DistanceArguments& a,
                          const std::vector<std::string>& others);

/// "within 0.49 of the surface ... (asked for 0.5)"; REQUIRES: r.distance or r.within_budget.
std::string distance_text(const DistanceArguments& a, const ExtractReport& r);
/// What was done with a kept analysis, in one line; or empty.
std::string analysis_text(const ExtractReport& r);
/// ", simplified from 1000 triangles"; or empty.
std::string simplified_text(const ExtractReport& r);
/// Adds what the report has of them.
void add_distance_json(Json& json, const ExtractReport& r);

}  // namespace isonest::detail::cli
