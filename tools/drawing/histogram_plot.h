// The histogram of a store's values as a plot.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "query/statistics/histogram.h"

namespace isonest::detail::cli {

/// How a value is written.
using ValueText = std::function<std::string(double)>;

/// Draws the nodes of each bin as bars, the cubes of each isovalue as a line, both logarithmic, and
/// the suggested isovalues as upright lines. Whole or not at all. Throws what draw_canvas() throws.
void draw_histogram(const std::filesystem::path& path, const std::string& title,
                    const Histogram& histogram, const ValueText& text);

}  // namespace isonest::detail::cli
