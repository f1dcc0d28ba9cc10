#include "tools/cli/options/component_options.h"

#include <fmt/format.h>

#include <limits>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

constexpr std::int64_t kMostElements = std::numeric_limits<std::int64_t>::max();

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
        return static_cast<std::uint64_t>(parse_integer("--components", text, 1, kMostElements));
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
    return {
        add_parsed(
            command, "--components",
            [&choice](const std::string& text) { chosen(choice).largest = parse_largest(text); },
            "of the surface's connected pieces keep the largest, the K\n"
            "largest (by triangles), or all, and say how many there are",
            "largest|K|all"),
        add_parsed(
            command, "--min-component",
            [&choice](const std::string& text) {
                chosen(choice).least_triangles = static_cast<std::uint64_t>(
                    parse_integer("--min-component", text, 0, kMostElements));
            },
            "drop pieces of fewer triangles (in a plane: lines); before\n"
            "--distance simplifies",
            "N"),
        add_parsed(
            command, "--min-volume",
            [&choice](const std::string& text) {
                chosen(choice).least_volume = parse_volume(text);
            },
            "drop closed pieces around less than this volume, a number in\n"
            "cubes of the store's unit; open ones stay",
            "V")};
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

}  // namespace isonest::detail::cli
