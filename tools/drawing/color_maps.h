// Colours for values, by the names of the usual maps.
#pragma once

#include <array>
#include <string>
#include <vector>

namespace isonest::detail::cli {

using Rgb = std::array<double, 3>;  ///< 0 to 255

/// Thread-safety: const methods from any thread.
class ColorMap {
  public:
    /// One of color_map_names(), with "_r" at the end the other way round. Throws
    /// Error{invalid_argument}; `option` is named in the message.
    ColorMap(const std::string& name, const std::string& option);
    /// Of t from 0 to 1; beyond, the colour of the end.
    [[nodiscard]] Rgb color(double t) const;

  private:
    std::vector<Rgb> colors_;  ///< at equal distances
};

/// Sources: color_map_tables.inc.
std::vector<std::string> color_map_names();

/// For the help of an option: "WHAT: viridis, ... [STANDARD]" in lines.
std::string color_help(const std::string& what, const std::string& standard);

}  // namespace isonest::detail::cli
