// Parts of the library that are loaded when they are needed: each stands on a library of others
// that every program which is linked with it would pay for at its start.
#pragma once

#include <string>

namespace isonest::detail {

/// A file of its own, isonest_NAME.so.
struct LoadedModule {
    const char* file;
    const char* does;     ///< what it is for, as in "reads OpenVDB"
    const char* package;  ///< of isonest, that has it
    const char* needs;    ///< Debian's packages that it cannot be loaded without
};

/// The module's function of that name, which is extern "C"; the module stays loaded from then on.
/// It is looked for where a shared library or a Python package that holds this code keeps it,
/// beside the program's folder, and where isonest is installed. `input` is the file that needs it.
/// Throws Error{unsupported}, naming `input`. Thread-safe.
void* load_from_module(const LoadedModule& module, const char* function, const std::string& input);

}  // namespace isonest::detail
