#include "preprocess/sources/module_loader.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

#include <filesystem>
#include <system_error>
#include <vector>

#include <isonest/error.h>

#include "store/base/workers.h"

namespace isonest::detail {
namespace {

namespace fs = std::filesystem;

/// The folder of the program, or of the shared library that contains this code.
fs::path own_folder(const fs::path& program) {
    Dl_info info{};
    void* map = nullptr;
    const auto* const here = reinterpret_cast<const void*>(&load_from_module);
    if (::dladdr1(here, &info, &map, RTLD_DL_LINKMAP) == 0) {
        return program;
    }
    // Empty for the program itself.
    const fs::path file = static_cast<const ::link_map*>(map)->l_name;
    std::error_code ignored;
    return file.empty() ? program : fs::absolute(file, ignored).parent_path();
}

std::vector<fs::path> module_folders() {
    std::error_code ignored;
    const fs::path program = fs::read_symlink("/proc/self/exe", ignored).parent_path();
    const fs::path own = own_folder(program);
    std::vector<fs::path> folders;
    if (own != program) {
        folders = {own / "isonest",      // beside a shared library
                   own / "lib/isonest",  // in a Python package
                   // and relative to the prefix of one in lib/python3/dist-packages/isonest
                   own / "../../../.." / ISONEST_LIBDIR / "isonest"};
    }
    folders.insert(folders.end(),
                   {program / "../lib/isonest", program / ".." / ISONEST_LIBDIR / "isonest",
                    ISONEST_FULL_LIBDIR "/isonest"});
    return folders;
}

}  // namespace

void* load_from_module(const LoadedModule& module, const char* function, const std::string& input) {
    std::string problem;
    bool is_installed = false;
    for (const fs::path& folder : module_folders()) {
        const fs::path file = folder / module.file;
        if (void* const loaded = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL)) {
            if (void* const found = ::dlsym(loaded, function)) {
                return found;
            }
        }
        const char* const said = ::dlerror();
        std::error_code ignored;
        if (fs::exists(file, ignored)) {
            is_installed = true;
            problem = said == nullptr ? "" : said;
        }
    }
    if (!is_installed) {
        throw Error(ErrorKind::unsupported, {input},
                    fmt::format("the module that {} is not installed; install the package {}",
                                module.does, module.package));
    }
    throw_if_no_room_to_load(input, fmt::format("the module that {}", module.does), problem);
    throw Error(ErrorKind::unsupported, {input},
                fmt::format("the module that {} cannot be loaded: {}", module.does, problem),
                {{RemedyKind::install_package, module.needs}});
}

}  // namespace isonest::detail
