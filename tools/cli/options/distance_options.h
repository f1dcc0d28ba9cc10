// The options of extract that ask for a distance or for a number of triangles.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <isonest/extract.h>

#include "tools/cli/command.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {

struct DistanceArguments {
    std::optional<DistanceBound> distance;  ///< as given until resolve()
    Length length;                          ///< the distance as given
    std::string unit;                       ///< behind a length of a report: " mm"
    std::uint64_t triangles = 0;            ///< 0: not asked for
    bool nested = false;                    ///< elements of the nested grid, not simplified
    std::optional<KeptAnalysis> analysis;
    bool by_error = false;  ///< the error is what the number of triangles makes small
    bool simplify = false;  ///< within the error
    std::optional<Effort> effort;

    /// Throws Error{invalid_argument} if there is an effort with nothing that takes one.
    void require_sense() const;

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
