#include "tools/drawing/color_maps.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>

#include <isonest/error.h>

namespace isonest::detail::cli {
namespace {

struct Table {
    std::string_view name;
    std::string_view colors;  ///< six hexadecimal digits each
};

constexpr std::array<Table, 28> kTables{{
#include "tools/drawing/color_map_tables.inc"
}};

}  // namespace

std::vector<std::string> color_map_names() {
    std::vector<std::string> names;
    names.reserve(kTables.size());
    for (const Table& table : kTables) {
        names.emplace_back(table.name);
    }
    return names;
}

std::string color_help(const std::string& what, const std::string& standard) {
    constexpr std::size_t kColumns = 50;
    std::string text = what + ":";
    std::size_t width = text.size();
    for (const std::string& name : color_map_names()) {
        const bool breaks = width + name.size() > kColumns;
        text += (breaks ? "\n" : " ") + name + ",";
        width = (breaks ? 0 : width) + name.size() + 2;
    }
    return text + "\nwith _r at the end the other way round [" + standard + "]";
}

ColorMap::ColorMap(const std::string& name, const std::string& option) {
    const bool reversed = name.ends_with("_r");
    const std::string_view wanted =
        reversed ? std::string_view(name).substr(0, name.size() - 2) : std::string_view(name);
    const auto* const table = std::find_if(kTables.begin(), kTables.end(),
                                           [&](const Table& t) { return t.name == wanted; });
    if (table == kTables.end()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': there are {}; with _r at the end the other way round",
                                option, name, fmt::join(color_map_names(), ", ")));
    }
    constexpr std::size_t kDigits = 6;
    for (std::size_t at = 0; at < table->colors.size(); at += kDigits) {
        Rgb color{};
        for (std::size_t c = 0; c < 3; ++c) {
            color.at(c) = std::stoi(std::string(table->colors.substr(at + 2 * c, 2)), nullptr, 16);
        }
        colors_.push_back(color);
    }
    if (reversed) {
        std::reverse(colors_.begin(), colors_.end());
    }
}

Rgb ColorMap::color(double t) const {
    const double at = std::clamp(t, 0.0, 1.0) * static_cast<double>(colors_.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(at), colors_.size() - 2);
    const double rest = at - static_cast<double>(i);
    Rgb out{};
    for (std::size_t c = 0; c < 3; ++c) {
        out.at(c) = colors_[i].at(c) + rest * (colors_[i + 1].at(c) - colors_[i].at(c));
    }
    return out;
}

}  // namespace isonest::detail::cli
