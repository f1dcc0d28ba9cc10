// Writes synthetic volumes of any size.
#pragma once

#include <filesystem>
#include <string>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/value_type.h>

namespace isonest::detail {

struct MakeVolumeOptions {
    std::string name = "bucky";  ///< see synthetic_names()
    Int3 nodes{129, 129, 129};
    ValueType type = ValueType::f32;  ///< integers: the function's range on the type's range
    std::uint64_t seed = 1;
    int threads = 0;  ///< 0 = all cores
    bool force = false;
};

/// Evaluates the function plane by plane; memory does not grow with the number of planes.
/// Throws Error{invalid_argument, unsupported, io, cancelled}.
void make_volume(const std::filesystem::path& path, const MakeVolumeOptions& options,
                 Progress& progress);

}  // namespace isonest::detail
