// Parts of the library that are loaded on demand. Each depends on another library that would
// otherwise delay the start of every program linked with isonest.
#pragma once

#include <string>

namespace isonest::detail {

/// A separate file, isonest_NAME.so.
struct LoadedModule {
    const char* file;
    const char* does;     ///< its purpose, as in "reads OpenVDB"
    const char* package;  ///< the isonest package that contains it
    const char* needs;    ///< Debian packages that it requires
};

/// Returns the module's extern "C" function of that name; the module then stays loaded. Searched in
/// the directories that belong to the shared library or Python package containing this code, beside
/// the program's folder, and where isonest is installed. `input` is the file that needs the module.
/// Throws Error{unsupported}, naming `input`. Thread-safe.
void* load_from_module(const LoadedModule& module, const char* function, const std::string& input);

}  // namespace isonest::detail
