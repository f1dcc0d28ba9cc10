// The frame of a VTKHDF PolyData file, whose arrays are filled in place.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace isonest::detail {

struct PolyDataShape {
    struct Attribute {
        std::string name;
        int components = 1;
        bool wide = false;          ///< float64 in place of float32
        bool of_triangles = false;  ///< there is an array per triangle, too
    };
    std::uint64_t points = 0;
    std::uint64_t triangles = 0;
    std::vector<Attribute> attributes;  ///< per point
    bool labels_of_triangles = false;   ///< there is an array "BoundaryLabels"
    std::string unit = {};              ///< of length; empty: not known
    std::string space = {};             ///< "RAS" or "LPS", of the points; empty: not known
};

/// Where the arrays' bytes begin in the file, row by row.
struct PolyDataOffsets {
    std::uint64_t points = 0;               ///< float32 x 3
    std::vector<std::uint64_t> attributes;  ///< float32 or float64 x components
    /// Likewise of each triangle; 0 unless the attribute is of triangles, too.
    std::vector<std::uint64_t> attributes_of_triangles;
    std::uint64_t labels_of_triangles = 0;  ///< int64 x 2; 0 if there is none
    std::uint64_t connectivity = 0;         ///< int64 x 3 for each triangle
    std::uint64_t ends = 0;                 ///< int64: three times the triangles so far
};

/// Creates the file with all arrays allocated, little endian and contiguous. The Offsets
/// begin with a 0 in front of `ends`, to be written too. The format: Kitware, "VTKHDF File Format",
/// version 2.0. Throws Error{io}.
PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape);

/// Where the arrays of such a file are.
struct PolyDataArrays {
    struct Array {
        std::uint64_t offset = 0;  ///< of the first number in the file
        std::uint64_t count = 0;   ///< of numbers
        bool wide = false;         ///< 64 bits
        bool integers = false;
    };
    Array points;
    Array connectivity;          ///< three corners for each triangle
    Array ends;                  ///< as of PolyDataOffsets
    std::optional<Array> value;  ///< the attribute "value" of the points
};

/// Throws Error{corrupt, not_found}, and Error{unsupported} for another kind of VTKHDF, or arrays
/// that are not contiguous and little endian.
PolyDataArrays find_polydata(const std::filesystem::path& path);

}  // namespace isonest::detail
