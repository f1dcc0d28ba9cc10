#include "tools/cli/options/isovalue_option.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

const std::string kPlace = "{iso}";

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
        "the isovalue; or several, for which the store is read once:\n"
        "MESH then has {iso} in its name, and is a file for each",
        "V[,V...]");
}

std::string mesh_name(std::string mesh, const std::string& iso) {
    for (std::size_t at = mesh.find(kPlace); at != std::string::npos;
         at = mesh.find(kPlace, at + iso.size())) {
        mesh.replace(at, kPlace.size(), iso);
    }
    return mesh;
}

void require_own_names(const std::string& mesh) {
    if (mesh.find(kPlace) == std::string::npos) {
        throw Error(ErrorKind::invalid_argument, {mesh},
                    "several isovalues are written to a file each: give the mesh a name with "
                    "{iso} in it, as in surface_{iso}.ply");
    }
}

}  // namespace isonest::detail::cli
