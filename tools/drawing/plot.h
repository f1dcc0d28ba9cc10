// Line plots with logarithmic axes, as SVG or PNG.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace isonest::detail::cli {

struct PlotSeries {
    std::string name;
    std::vector<std::pair<double, double>> points;  ///< those with a coordinate <= 0 are left out
};

struct Plot {
    std::string title;
    std::string x;
    std::string y;
    std::vector<PlotSeries> series;
};

/// Draws with both axes logarithmic; the name ends with .svg or .png. Whole or not at all.
/// Throws Error{io, invalid_argument}.
void draw_plot(const std::filesystem::path& path, const Plot& plot);

}  // namespace isonest::detail::cli
