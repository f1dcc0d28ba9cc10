#include "tools/cli/options/surface_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string_view>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

constexpr const char* kBare = "true";  ///< stands for a flag without a value

Outside parse_outside(const std::string& text) {
    if (text == "below" || text == kBare) {
        return Outside::below;
    }
    if (text == "above") {
        return Outside::above;
    }
    throw Error(ErrorKind::invalid_argument,
                fmt::format("--close '{}': give below or above; the outside then counts as below "
                            "the isovalue, or above it",
                            text));
}

}  // namespace

CLI::Option* add_close_option(CLI::App* command, std::optional<Outside>& close) {
    // A value must follow "=", so that the flag never takes the name of a store.
    return command->add_flag("--close")->each(
        [&close](const std::string& text) { close = parse_outside(text); });
}

std::string close_text(const ClosingReport& r, bool has_box) {
    const std::string where = has_box ? "box" : "volume";
    if (r.border_vertices == 0) {
        return fmt::format("closed at the faces of the {}: every edge has two triangles\n", where);
    }
    return fmt::format(
        "closed at the faces of the {}, but open at missing values: {} vertices lie on borders\n",
        where, r.border_vertices);
}

void add_close_json(const ClosingReport& r, Json& json) {
    json["closed"] = r.outside == Outside::below ? "below" : "above";
    json["border_vertices"] = r.border_vertices;
}

namespace {

constexpr std::int64_t kMaxElements = std::numeric_limits<std::int64_t>::max();

ComponentChoice& chosen(std::optional<ComponentChoice>& choice) {
    if (!choice) {
        choice.emplace();
    }
    return *choice;
}

/// 0 = all.
std::uint64_t parse_largest(const std::string& text) {
    if (text == "all") {
        return 0;
    }
    if (text == "largest") {
        return 1;
    }
    try {
        return static_cast<std::uint64_t>(parse_integer("--components", text, 1, kMaxElements));
    } catch (const Error&) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--components '{}': give largest, all, or how many of the largest "
                                "to keep, 1 or more",
                                text));
    }
}

double parse_volume(const std::string& text) {
    const double volume = parse_number("--min-volume", text);
    if (volume < 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--min-volume '{}': give a number >= 0", text));
    }
    return volume;
}

std::string counted(std::uint64_t count, const char* what) {
    return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

}  // namespace

std::vector<CLI::Option*> add_component_options(CLI::App* command,
                                                std::optional<ComponentChoice>& choice) {
    return {add_parsed(command, "--components",
                       [&choice](const std::string& text) {
                           chosen(choice).largest = parse_largest(text);
                       }),
            add_parsed(command, "--min-component",
                       [&choice](const std::string& text) {
                           chosen(choice).min_triangles = static_cast<std::uint64_t>(
                               parse_integer("--min-component", text, 0, kMaxElements));
                       }),
            add_parsed(command, "--min-volume", [&choice](const std::string& text) {
                chosen(choice).min_volume = parse_volume(text);
            })};
}

std::string component_text(const ExtractReport& r) {
    const ComponentReport& c = *r.components;
    const char* const element = r.dimension == 2 ? "line segment" : "triangle";
    if (c.dropped == 0) {
        return counted(c.components, "component") + ", none dropped\n";
    }
    if (c.dropped == c.components) {
        return fmt::format(
            "The mesh is empty: all components of the surface were dropped, {} with "
            "{}, the largest of {}.\n",
            c.components, counted(c.dropped_triangles, element), c.largest_dropped);
    }
    return fmt::format("dropped {} of {} with {}, the largest of {}{}\n", c.dropped,
                       counted(c.components, "component"), counted(c.dropped_triangles, element),
                       c.largest_dropped,
                       r.distance ? "; the distance is to the surface without them" : "");
}

void add_component_json(const ComponentReport& r, Json& json) {
    json["components"] = r.components;
    json["dropped_components"] = r.dropped;
    json["dropped_triangles"] = r.dropped_triangles;
    json["largest_dropped"] = r.largest_dropped;
}

namespace {

constexpr std::string_view kPlace = "{iso}";

}  // namespace

CLI::Option* add_isovalue_option(CLI::App* command, Isovalues& isovalues) {
    return add_parsed(command, "--iso", [&isovalues](const std::string& text) {
        for (std::size_t at = 0; at <= text.size();) {
            const std::size_t end = std::min(text.find(',', at), text.size());
            const std::string item = text.substr(at, end - at);
            isovalues.all.push_back(parse_number("--iso", item));
            isovalues.texts.push_back(item);
            at = end + 1;
        }
    });
}

std::string mesh_name(std::string mesh, const std::string& iso) {
    for (std::size_t at = mesh.find(kPlace); at != std::string::npos;
         at = mesh.find(kPlace, at + iso.size())) {
        mesh.replace(at, kPlace.size(), iso);
    }
    return mesh;
}

bool is_own_name(const std::string& mesh) {
    return mesh.find(kPlace) != std::string::npos;
}

void require_place_for_isovalue(const std::string& mesh) {
    const std::string end = lower_extension(mesh);
    if (end != ".ply" && end != ".vtp" && end != ".vtkhdf") {
        throw Error(ErrorKind::invalid_argument, {mesh},
                    "several isovalues in one file need .ply, .vtp, .vtkhdf, .glb or .3mf; for a "
                    "file each, "
                    "put {iso} into the name: surface_{iso}.stl");
    }
}

void DistanceArguments::resolve(std::optional<LengthUnit> of_world, const std::string& name) {
    unit = unit_suffix(of_world);
    if (distance && !length.voxels) {
        distance->value = in_world_units(length, of_world, name);
    }
}

std::optional<SurfaceStop> DistanceArguments::stop() const {
    if (by_error) {
        return TriangleBudgetByError{triangles};
    }
    if (triangles > 0) {
        return TriangleBudgetByDistance{triangles, distance};
    }
    if (distance) {
        return *distance;
    }
    return std::nullopt;
}

void add_distance_options(CLI::App* c, DistanceArguments& a,
                          const std::vector<std::string>& others) {
    CLI::Option* const distance = add_parsed(c, "--distance", [&a](const std::string& text) {
        a.length = parse_length("--distance", text);
        a.distance = DistanceBound{a.length.value, a.length.voxels};
    });
    CLI::Option* const triangles = add_parsed(c, "--triangles", [&a](const std::string& text) {
        a.triangles = static_cast<std::uint64_t>(
            parse_integer("--triangles", text, 1, std::numeric_limits<std::int64_t>::max()));
    });
    CLI::Option* const by = add_parsed(c, "--by", [&a](const std::string& text) {
        if (text != "distance" && text != "error") {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--by '{}': give distance or error", text));
        }
        a.by_error = text == "error";
    });
    by->needs(triangles);
    // A value must follow "=", so that the flag never takes the name of a store.
    CLI::Option* const keep = c->add_flag("--keep-analysis")->each([&a](const std::string& text) {
        a.analysis.emplace();
        if (text != "true") {
            a.analysis->folder = text;
        }
    });
    add_parsed(c, "--effort", [&a](const std::string& text) {
        if (text != "none" && text != "fast" && text != "best") {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--effort '{}': give none, fast or best", text));
        }
        a.effort = text == "none" ? Effort::none : text == "fast" ? Effort::fast : Effort::best;
    })->excludes(c->get_option("--graph"));
    for (const std::string& other : others) {
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
            return fmt::format("{}: belonged to another store or version, and was replaced\n",
                               file);
        case AnalysisUse::replaced_damaged:
            return fmt::format("{}: was damaged, and was replaced\n", file);
        case AnalysisUse::not_used:
            break;
    }
    return "No analysis was used: analyses are no finer than an eighth of a voxel.\n";
}

std::string distance_text(const DistanceArguments& a, const ExtractReport& r) {
    if (!r.distance) {
        return fmt::format("error at most {:.6g} (asked for {} triangles){}{}", r.error_bound,
                           a.triangles, simplified_text(r), rounded_text(r));
    }
    const DistanceReport& distance = *r.distance;
    if (a.effort == Effort::none && distance.bound > 0) {
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
    if (!r.simplified_error || r.simplified_error->nested_triangles == 0) {
        return "";
    }
    const std::string from =
        fmt::format(", simplified from {} triangles", r.simplified_error->nested_triangles);
    const std::optional<double>& full = r.simplified_error->full_bound;
    return full && *full > r.error_bound
               ? from +
                     fmt::format(
                         "; up to {:.6g} in triangles kept from the full-resolution surface", *full)
               : from;
}

void add_distance_json(Json& json, const ExtractReport& r) {
    if (r.within_budget) {
        json["within_budget"] = *r.within_budget;
    }
    if (r.simplified_error && r.simplified_error->nested_triangles > 0) {
        json["nested_triangles"] = r.simplified_error->nested_triangles;
        if (const auto& full = r.simplified_error->full_bound) {
            json["full_error_bound"] = std::isfinite(*full) ? Json(*full) : Json();
        }
        json["scratch_bytes"] = r.scratch_bytes;
    }
    if (!r.distance) {
        return;
    }
    if (r.analysis) {
        json["analysis"] = name_of(r.analysis->use);
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
