// The frame of a VTKHDF PolyData file, whose arrays are filled in place.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace isonest::detail {

struct PolyDataShape {
    struct Attribute {
        std::string name;
        int components = 1;
        bool wide = false;  ///< float64 in place of float32
    };
    std::uint64_t points = 0;
    std::uint64_t triangles = 0;
    std::vector<Attribute> attributes;  ///< per point
};

/// Where the arrays' bytes begin in the file, row by row.
struct PolyDataOffsets {
    std::uint64_t points = 0;               ///< float32 x 3
    std::vector<std::uint64_t> attributes;  ///< float32 or float64 x components
    std::uint64_t connectivity = 0;         ///< int64 x 3 for each triangle
    std::uint64_t ends = 0;                 ///< int64: three times the triangles so far
};

/// Creates the file with all arrays allocated, little endian and contiguous. The Offsets
/// begin with a 0 in front of `ends`, to be written too. The format: Kitware, "VTKHDF File Format",
/// version 2.0. Throws Error{io}.
PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape);

}  // namespace isonest::detail
