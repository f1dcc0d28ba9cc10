#include "tools/cli/options/distance_options.h"

#include <fmt/format.h>

#include <limits>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

const char* analysis_name(AnalysisUse use) {
    switch (use) {
        case AnalysisUse::made:
            return "made";
        case AnalysisUse::found:
            return "found";
        case AnalysisUse::replaced_stale:
            return "replaced_stale";
        case AnalysisUse::replaced_damaged:
            return "replaced_damaged";
        case AnalysisUse::not_used:
            break;
    }
    return "not_used";
}

}  // namespace

void DistanceArguments::resolve(std::optional<LengthUnit> of_world, const std::string& name) {
    unit = unit_suffix(of_world);
    if (distance && !length.voxels) {
        distance->value = in_world_units(length, of_world, name);
    }
}

void DistanceArguments::require_sense() const {
    if (effort && (by_error || nested || (!distance && triangles == 0))) {
        throw Error(ErrorKind::invalid_argument,
                    "--effort goes with --distance or --triangles, without --by error and "
                    "--no-simplify");
    }
}

std::optional<SurfaceStop> DistanceArguments::stop() const {
    if (by_error) {
        return ErrorBudget{.most = triangles, .simplified = simplify};
    }
    if (triangles > 0) {
        return TriangleBudget{triangles, distance, effort.value_or(Effort::best)};
    }
    if (distance && nested) {
        return NestedDistanceBound{*distance};
    }
    if (distance) {
        return DistanceBound{distance->value, distance->voxels, effort.value_or(Effort::best)};
    }
    return std::nullopt;
}

void add_distance_options(CLI::App* c, DistanceArguments& a,
                          const std::vector<std::string>& others) {
    CLI::Option* const distance = add_parsed(
        c, "--distance",
        [&a](const std::string& text) {
            a.length = parse_length("--distance", text);
            a.distance = DistanceBound{a.length.value, a.length.voxels};
        },
        "in place of the error: simplify, at most this far from the\n"
        "surface at full resolution, anywhere and in both directions;\n"
        "in the store's unit, in another one (0.5mm, 20um), or in voxels\n"
        "(0.5voxel)",
        "D[UNIT]");
    CLI::Option* const triangles = add_parsed(
        c, "--triangles",
        [&a](const std::string& text) {
            a.triangles = static_cast<std::uint64_t>(
                parse_integer("--triangles", text, 1, std::numeric_limits<std::int64_t>::max()));
        },
        "in place of the error: at most so many triangles, at the\n"
        "smallest distance that is found; with --distance: whichever\n"
        "is reached first",
        "N");
    CLI::Option* const by = add_parsed(
        c, "--by",
        [&a](const std::string& text) {
            if (text != "distance" && text != "error") {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--by '{}': give distance or error", text));
            }
            a.by_error = text == "error";
        },
        "what --triangles makes small: the distance (if not given), or\n"
        "the error of the values, with triangles of the nested grid, or\n"
        "with those that --simplify makes",
        "distance|error");
    by->needs(triangles);
    CLI::Option* const simplify =
        c->add_flag("--simplify", a.simplify,
                    "with --error, or --by error: fewer triangles than the nested grid\n"
                    "has, the error proven on them; takes longer");
    simplify->excludes(distance);
    // A flag's value comes behind "=" alone, so that it never takes the name of a store.
    CLI::Option* const keep =
        c->add_flag("--keep-analysis")
            ->description(
                "keep an analysis of the surface beside the store, or in\n"
                "--keep-analysis=FOLDER: made once, in several times the time;\n"
                "other distances and numbers of triangles then take little")
            ->each([&a](const std::string& text) {
                a.analysis.emplace();
                if (text != "true") {
                    a.analysis->folder = text;
                }
            });
    for (const char* const other : {"--stop", "--focus", "--camera", "--graph"}) {
        simplify->excludes(c->get_option(other));
    }
    CLI::Option* const nested = c->add_flag(
        "--no-simplify", a.nested, "within the distance, but with the nested grid's own triangles");
    nested->needs(distance)->excludes(triangles)->excludes(keep);
    CLI::Option* const effort = add_parsed(
        c, "--effort",
        [&a](const std::string& text) {
            if (text != "fast" && text != "best") {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--effort '{}': give fast or best", text));
            }
            a.effort = text == "fast" ? Effort::fast : Effort::best;
        },
        "with --distance or --triangles: the fewest triangles [best], or\n"
        "more of them in less time; the distance holds for both",
        "fast|best");
    for (const std::string& other : others) {
        effort->excludes(c->get_option(other));
        keep->excludes(c->get_option(other));
        distance->excludes(c->get_option(other));
        triangles->excludes(c->get_option(other));
    }
}

std::string analysis_text(const ExtractReport& r) {
    if (!r.analysis) {
        return "";
    }
    const std::string file = r.analysis->file.string();
    switch (r.analysis->use) {
        case AnalysisUse::made:
            return fmt::format("{}: the analysis of this surface, made and kept\n", file);
        case AnalysisUse::found:
            return fmt::format("{}: made from this analysis\n", file);
        case AnalysisUse::replaced_stale:
            return fmt::format("{}: was of another store or version, and made anew\n", file);
        case AnalysisUse::replaced_damaged:
            return fmt::format("{}: was damaged, and made anew\n", file);
        case AnalysisUse::not_used:
            break;
    }
    return "No analysis was used: what is asked for is finer than an analysis holds, an eighth of "
           "a "
           "voxel.\n";
}

std::string distance_text(const DistanceArguments& a, const ExtractReport& r) {
    if (!r.distance) {
        return fmt::format("error at most {:.6g} (asked for {} triangles){}", r.error_bound,
                           a.triangles, simplified_text(r));
    }
    const DistanceReport& distance = *r.distance;
    if (a.nested && distance.bound > 0) {
        return fmt::format(
            "within {:.4g}{} of the surface at full resolution (asked for {:.4g}{}), triangles of "
            "the "
            "nested grid",
            distance.bound, a.unit, distance.asked, a.unit);
    }
    if (distance.full_triangles == 0) {
        return "the surface at full resolution";
    }
    const std::string within = fmt::format(
        "within {:.4g}{} of the surface at full resolution, which has {} {}", distance.bound,
        a.unit, distance.full_triangles, r.dimension == 2 ? "line segments" : "triangles");
    if (!r.within_budget) {
        return within + fmt::format(" (asked for {:.4g}{})", distance.asked, a.unit);
    }
    return within + (*r.within_budget
                         ? fmt::format(" (asked for {} triangles)", a.triangles)
                         : fmt::format(" (the distance {:.4g}{} was reached before {} triangles)",
                                       distance.asked, a.unit, a.triangles));
}

std::string simplified_text(const ExtractReport& r) {
    return r.simplified_error && r.simplified_error->nested_triangles > 0
               ? fmt::format(", simplified from {} triangles", r.simplified_error->nested_triangles)
               : "";
}

void add_distance_json(Json& json, const ExtractReport& r) {
    if (r.within_budget) {
        json["within_budget"] = *r.within_budget;
    }
    if (r.simplified_error && r.simplified_error->nested_triangles > 0) {
        json["nested_triangles"] = r.simplified_error->nested_triangles;
        json["scratch_bytes"] = r.scratch_bytes;
    }
    if (!r.distance) {
        return;
    }
    if (r.analysis) {
        json["analysis"] = analysis_name(r.analysis->use);
        json["analysis_file"] = r.analysis->file.string();
    }
    json["distance"] = r.distance->asked;
    json["distance_bound"] = r.distance->bound;
    json["full_triangles"] = r.distance->full_triangles;
    if (const auto& full = r.distance->full) {
        json["full_area"] = full->area;
        json["full_volume"] = full->volume ? Json(*full->volume) : Json();
    }
    json["scratch_bytes"] = r.scratch_bytes;
}

}  // namespace isonest::detail::cli
