// The options that all commands share which extract a mesh from a store.
#pragma once

#include <memory>
#include <string>

#include "query/extract/extract.h"
#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// Options with what they need beside ExtractOptions.
struct ExtractArguments {
    std::string store;
    std::string mesh;
    std::string values;  ///< a second store, or empty
    ExtractOptions extract;
    double falloff = 0;
};

/// STORE, the error, the stop test, focus and camera, --box, --memory, --threads.
void add_extract_options(CLI::App* command, ExtractArguments& a);

/// "at most 0.25 (asked for 0.3)": what the error of the mesh is known to be, in one line.
std::string guarantee_text(const ExtractArguments& a, const ExtractReport& r);
/// Whether the line above is a bound on |U - iso| (or on |value - U| in a slice).
bool is_guaranteed(const ExtractReport& r);
/// What was left behind by killed runs, and coordinates that float32 rounds too much; or empty.
std::string extract_warning(const ExtractArguments& a, const ExtractReport& r);
/// Whether the box and the volume have more than a face in common along each axis that the volume
/// has.
bool reaches_volume(const StoreReader& store, const WorldBox& box);
/// "which lies between 0,0,0 and 9,9,9".
std::string volume_text(const StoreReader& store);
/// What every such command reports.
Json extract_json(const ExtractArguments& a, const ExtractReport& r);

}  // namespace isonest::detail::cli
