#include "tools/cli/terminal/paraview_hint.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>

namespace isonest::detail::cli {
namespace {

namespace fs = std::filesystem;

/// The folder with the zstd filter: of the build tree, or where the program is installed. Empty if
/// there is none.
std::string filter_folder() {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    const fs::path prefix = program.parent_path().parent_path();
    for (const char* const folder : {"plugin", ISONEST_LIBDIR "/isonest/hdf5-plugin"}) {
        if (!error && fs::is_directory(prefix / folder, error)) {
            return (prefix / folder).string();
        }
    }
    return {};
}

}  // namespace

std::string paraview_hint(const std::string& store) {
    const std::string end = fs::path(store).extension().string();
    const std::string folder =
        std::getenv("HDF5_PLUGIN_PATH") == nullptr ? filter_folder() : std::string{};
    const std::string with =
        folder.empty() ? std::string{} : fmt::format(", with HDF5_PLUGIN_PATH={}", folder);
    if (end == ".hdf" || end == ".vtkhdf") {
        return fmt::format("ParaView {} opens it{}\n", end == ".hdf" ? "5.11" : "5.12", with);
    }
    return fmt::format(
        "ParaView opens it under a name with .hdf (5.11 on) or .vtkhdf (5.12 on) at "
        "the end{}\n",
        with);
}

}  // namespace isonest::detail::cli
