// From a store to an isosurface mesh with a guaranteed error.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>

#include "store/int3.h"
#include "store/progress.h"
#include "store/reader.h"

namespace isonest {

/// What the error tolerance promises.
enum class Guarantee {
    deviation,  ///< |U - iso| <= error on the surface, by the deviation indicator: tight
    plus,       ///< the same, by eta+ of the offset indicator: looser, more triangles
    estimate    ///< eta bar of the offset indicator: usually close, no promise
};

/// A box in world units.
struct WorldBox {
    Double3 lo{};
    Double3 hi{};
};

struct ExtractOptions {
    double iso = 0;
    std::optional<double> error;  ///< in units of the data; 0 (the default) = full resolution
    std::optional<double> error_relative;  ///< relative to the data's range
    Guarantee guarantee = Guarantee::deviation;
    std::optional<WorldBox> box;                     ///< the surface is cut at the box
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most
    int threads = 0;                                 ///< 0 = all cores
    bool force = true;                               ///< replace an existing mesh file
};

struct ExtractReport {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    double tolerance = 0;    ///< the error asked for, in units of the data
    double error_bound = 0;  ///< largest indicator at which a visited leaf stopped; <= tolerance
    std::uint64_t visited_tetrahedra = 0;
    std::uint64_t leaf_tetrahedra = 0;      ///< visited, not refined further, and holding surface
    std::uint64_t zero_area_triangles = 0;  ///< left where coordinates round to the same place
    std::uint64_t chunks_read = 0;
    std::uint64_t chunks_total = 0;
    std::uint64_t bytes_read = 0;  ///< stored bytes of the chunks read
    std::uint64_t peak_cache_bytes = 0;
    std::uint64_t bricks = 0;
    double seconds = 0;
};

/// Writes the isosurface {U = iso} as binary PLY, coordinates float32 in world units, normals
/// toward smaller values. The bytes depend on the volume, iso, tolerance, guarantee and box alone.
/// An empty surface is a mesh without triangles.
/// Throws Error{invalid_argument} (non-finite iso, negative error), Error{not_found} (the store
/// lacks the field that the guarantee needs), Error{limit} (memory, or more than 2^32 - 1
/// vertices), Error{corrupt, io, cancelled}. Thread-safe for different outputs.
ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                      const ExtractOptions& options, Progress& progress);

}  // namespace isonest
