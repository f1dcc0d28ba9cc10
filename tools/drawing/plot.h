// Line plots with logarithmic axes, as SVG or PNG.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "query/statistics/histogram.h"

namespace isonest::detail::cli {

struct PlotSeries {
    std::string name;
    std::vector<std::pair<double, double>> points;  ///< points with a coordinate <= 0 are left out
};

struct Plot {
    std::string title;
    std::string x;
    std::string y;
    std::vector<PlotSeries> series;
};

/// Draws with two logarithmic axes; the file name extension is .svg or .png. The file appears only
/// when it is complete. Throws Error{io, invalid_argument}.
void draw_plot(const std::filesystem::path& path, const Plot& plot);

// The histogram of a store's values as a plot.

/// Formats a value.
using ValueText = std::function<std::string(double)>;

/// Draws the nodes of each bin as bars, the cubes of each isovalue as a line, both logarithmic, and
/// the suggested isovalues as vertical lines. The file appears only when it is complete. Throws
/// what draw_canvas() throws.
void draw_histogram(const std::filesystem::path& path, const std::string& title,
                    const Histogram& histogram, const ValueText& text);

}  // namespace isonest::detail::cli
