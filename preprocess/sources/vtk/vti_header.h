// The XML of VTK's images.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/vtk_grid.h"

namespace isonest::detail {

struct VtiArray {
    std::string name;
    std::string type;    ///< "Float32"
    std::string format;  ///< "appended", "binary" or "ascii"
    std::int64_t components = 1;
    std::uint64_t offset = 0;   ///< appended: bytes behind the mark
    std::uint64_t content = 0;  ///< otherwise: the byte of the file behind the start tag
    bool of_cells = false;
};

/// A box of the image with arrays of its own; points on the faces between two are in both.
struct VtiPiece {
    std::array<std::int64_t, 6> extent{};
    std::vector<VtiArray> arrays;
};

struct VtiHeader {
    bool big_endian = false;
    bool wide = false;  ///< sizes have 64 bits
    std::string compressor;
    std::array<std::int64_t, 6> extent{};
    VtkGrid grid;
    Double3 origin{0, 0, 0};
    std::vector<VtiPiece> pieces;  ///< at least one; none is empty
    std::string encoding;          ///< of appended data: "raw" or "base64"
    std::uint64_t appended = 0;    ///< the byte behind the mark
};

/// Reads the XML up to the appended data. Throws Error{corrupt, unsupported, io}.
VtiHeader read_vti_header(const InputFile& file);

}  // namespace isonest::detail
