#include "tools/cli/options/isovalue_option.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <string_view>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

constexpr std::string_view kPlace = "{iso}";

}  // namespace

CLI::Option* add_isovalue_option(CLI::App* command, Isovalues& isovalues) {
    return add_parsed(
        command, "--iso",
        [&isovalues](const std::string& text) {
            for (std::size_t at = 0; at <= text.size();) {
                const std::size_t end = std::min(text.find(',', at), text.size());
                const std::string item = text.substr(at, end - at);
                isovalues.all.push_back(parse_number("--iso", item));
                isovalues.texts.push_back(item);
                at = end + 1;
            }
        },
        "the isovalue; or several, for which the store is read once.\n"
        "With {iso} in its name MESH is a file for each; without, one\n"
        "file with all of them (.ply .vtp .vtkhdf)",
        "V[,V...]");
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
    std::string end = std::filesystem::path(mesh).extension().string();
    std::transform(end.begin(), end.end(), end.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (end != ".ply" && end != ".vtp" && end != ".vtkhdf") {
        throw Error(ErrorKind::invalid_argument, {mesh},
                    "of several isovalues in one file, .ply, .vtp and .vtkhdf say which is whose: "
                    "give one of these, or a name with {iso} in it for a file each, as in "
                    "surface_{iso}.stl");
    }
}

}  // namespace isonest::detail::cli
