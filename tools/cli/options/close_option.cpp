#include "tools/cli/options/close_option.h"

#include <fmt/format.h>

#include <isonest/error.h>

namespace isonest::detail::cli {
namespace {

constexpr const char* kBare = "true";  ///< what a flag without a value says

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
    // A flag's value comes behind "=" alone, so that it never takes the name of a store.
    return command->add_flag("--close")
        ->description(
            "close the surface where it meets the faces of the volume or\n"
            "the box: the outside counts as below the isovalue, or with\n"
            "--close=above as above it")
        ->each([&close](const std::string& text) { close = parse_outside(text); });
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

}  // namespace isonest::detail::cli
