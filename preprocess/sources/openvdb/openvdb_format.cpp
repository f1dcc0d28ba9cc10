#include "preprocess/sources/openvdb/openvdb_format.h"

#include <string_view>

#if ISONEST_WITH_OPENVDB
#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/openvdb/vdb_module.h"
#endif

namespace isonest::detail {
namespace {

bool is_vdb(const VolumeInput& input) {
    using namespace std::string_view_literals;
    return input.head.starts_with(" BDV\0\0\0\0"sv);
}

#if ISONEST_WITH_OPENVDB

using OpenVdb = decltype(&isonest_open_vdb);

/// In the build's folder beside that of the program, or where it is installed.
OpenVdb load_module(const std::string& input) {
    std::error_code ignored;
    const std::filesystem::path program =
        std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path();
    const std::array<std::filesystem::path, 3> folders{program / "../lib/isonest",
                                                       program / ".." / ISONEST_LIBDIR / "isonest",
                                                       ISONEST_FULL_LIBDIR "/isonest"};
    std::string problem;
    bool is_installed = false;
    for (const std::filesystem::path& folder : folders) {
        const std::filesystem::path file = folder / "isonest_openvdb.so";
        if (void* const module = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL)) {
            if (void* const open = ::dlsym(module, "isonest_open_vdb")) {
                return reinterpret_cast<OpenVdb>(open);
            }
        }
        const char* const said = ::dlerror();
        if (std::filesystem::exists(file, ignored)) {
            is_installed = true;
            problem = said == nullptr ? "" : said;
        }
    }
    if (!is_installed) {
        throw Error(ErrorKind::unsupported, {input},
                    "the module that reads OpenVDB is not installed: it is in the package "
                    "isonest-openvdb");
    }
    throw Error(ErrorKind::unsupported, {input},
                fmt::format("the module that reads OpenVDB cannot be loaded: {}", problem),
                {{RemedyKind::install_package, "libopenvdb-dev"}});
}

std::unique_ptr<VolumeSource> open_vdb(const VolumeInput& input, const SourceOptions& options) {
    static const OpenVdb open = load_module(input.path().string());
    return std::unique_ptr<VolumeSource>(open(input, options));
}

#endif

}  // namespace

VolumeFormat vdb_format() {
    return {
        .about = {"OpenVDB", ".vdb", "libopenvdb-dev"}, .takes = {.dataset = true},
        .recognises = is_vdb,
#if ISONEST_WITH_OPENVDB
        .open = open_vdb
#else
        .open = nullptr
#endif
    };
}

}  // namespace isonest::detail
