#include "tools/cli/terminal/histogram_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {

Json histogram_json(const Histogram& h) {
    const auto value = [&](double v) {
        return h.first_label ? Json(*h.first_label + static_cast<std::int64_t>(std::round(v)))
                             : Json(v);
    };
    Json bins = Json::array();
    for (std::size_t k = 0; k < h.nodes.size(); ++k) {
        bins.push_back({{"low", value(h.bins.low[k])},
                        {"nodes", h.nodes[k]},
                        {"cubes", h.cube_level ? Json(h.cubes[k]) : Json()}});
    }
    Json suggested = Json::array();
    for (const SuggestedIsovalue& s : h.suggested) {
        suggested.push_back({{"isovalue", s.isovalue}, {"cubes", s.cubes}});
    }
    return {{"level", h.level},      {"values", h.looked},
            {"missing", h.missing},  {"cube_level", h.cube_level ? Json(*h.cube_level) : Json()},
            {"bins", bins},          {"end", h.nodes.empty() ? Json() : value(h.bins.end)},
            {"suggested", suggested}};
}

namespace {

std::string sampled(const Histogram& h) {
    return h.level == 0 ? fmt::format("all {} values", h.looked)
                        : fmt::format("the {} values of level {} (every {}th along each axis)",
                                      h.looked, h.level, std::int64_t{1} << h.level);
}

/// The name of the elements that a surface passes through, which depends on the number of flat
/// axes.
const char* cubes_name(const Histogram& h) {
    return h.dimension == 3 ? "cubes" : h.dimension == 2 ? "squares" : "edges";
}

std::string cubes_of(const Histogram& h) {
    if (h.first_label) {
        return "The values are labels, which have no isosurfaces.\n";
    }
    if (!h.cube_level) {
        return fmt::format(
            "{}: not counted, because the store has no ranges of cubes; use --level 0 to count\n",
            cubes_name(h));
    }
    if (*h.cube_level == 0) {
        return fmt::format(
            "{}: number on the finest level that the surface of the row's first value crosses{}\n",
            cubes_name(h),
            h.dimension == 3 ? "; the\nfull surface has about 6 triangles in each" : "");
    }
    const int edge = 1 << *h.cube_level;
    return fmt::format(
        "cubes: number of blocks of {0}^3 cubes that the surface of the row's first value crosses; "
        "--level 0\ncounts cubes of the finest level\n",
        edge);
}

/// A bar of logarithmic length; at least one character unless `count` is 0.
std::string bar(std::uint64_t count, std::uint64_t most) {
    constexpr double kSigns = 30;
    if (count == 0) {
        return "";
    }
    const double part =
        std::log1p(static_cast<double>(count)) / std::log1p(static_cast<double>(most));
    std::string signs(std::max<std::size_t>(1, static_cast<std::size_t>(kSigns * part)), '#');
    return signs;
}

std::string rows(const Histogram& h) {
    constexpr std::size_t kMaxRows = 32;
    const std::size_t bins = h.nodes.size();
    const std::size_t each = (bins + kMaxRows - 1) / kMaxRows;
    std::vector<std::uint64_t> nodes;
    for (std::size_t k = 0; k < bins; k += each) {
        nodes.push_back(
            std::accumulate(h.nodes.begin() + static_cast<std::ptrdiff_t>(k),
                            h.nodes.begin() + static_cast<std::ptrdiff_t>(std::min(k + each, bins)),
                            std::uint64_t{0}));
    }
    const std::uint64_t most = *std::max_element(nodes.begin(), nodes.end());
    std::string text = fmt::format("{:>14} {:>12} {:>12}  {}\n", "value from", "nodes",
                                   cubes_name(h), "nodes, logarithmic");
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        const std::size_t k = i * each;
        text +=
            fmt::format("{:>14} {:>12} {:>12}  {}\n", value_text(h, h.bins.low[k]), nodes[i],
                        h.cube_level ? fmt::format("{}", h.cubes[k]) : "-", bar(nodes[i], most));
    }
    return text;
}

}  // namespace

std::string value_text(const Histogram& h, double value) {
    if (h.first_label) {
        return fmt::format("{}", *h.first_label + static_cast<std::int64_t>(std::round(value)));
    }
    // Halved, because the difference of the largest numbers would overflow.
    const std::vector<double>& low = h.bins.low;
    const double half_bin =
        low.empty() ? 0 : (h.bins.end / 2 - low.front() / 2) / static_cast<double>(low.size());
    return human_value(value, h.bins.integer ? 0.5 : half_bin);
}

std::string histogram_text(const Histogram& h) {
    std::string text =
        fmt::format("histogram of {}{}\n", sampled(h),
                    h.missing > 0 ? fmt::format(", {} of them missing", h.missing) : "");
    if (h.nodes.empty()) {
        return text + "all values are missing\n";
    }
    text += cubes_of(h) + "\n" + rows(h) + "\n";
    if (h.first_label) {
        return text;
    }
    if (h.suggested.empty()) {
        return text + "no isovalue to suggest: " +
               (h.cube_level ? "the values are too few, or all the same\n"
                             : "the cubes were not counted\n");
    }
    text += "suggested isovalues, with the sharpest surfaces (most cubes per node):\n";
    for (const SuggestedIsovalue& s : h.suggested) {
        text += fmt::format("{:>14} {:>25}\n", value_text(h, s.isovalue),
                            fmt::format("{} {}", s.cubes, cubes_name(h)));
    }
    return text;
}

}  // namespace isonest::detail::cli
