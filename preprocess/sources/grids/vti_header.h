// The XML of VTK images.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/conventions.h"

namespace isonest::detail {

struct VtiArray {
    std::string name;
    std::string type;    ///< "Float32"
    std::string format;  ///< "appended", "binary" or "ascii"
    std::int64_t components = 1;
    std::uint64_t offset = 0;   ///< appended: bytes after the mark
    std::uint64_t content = 0;  ///< otherwise: file offset of the byte after the start tag
    bool of_cells = false;
};

/// A box of the image with its own arrays; points on the face between two pieces are in both.
struct VtiPiece {
    std::array<std::int64_t, 6> extent{};
    std::vector<VtiArray> arrays;
    /// Of a rectilinear grid: along x, y and z. Of a structured grid: its points.
    std::vector<VtiArray> coordinates = {};
};

struct VtiHeader {
    bool rectilinear = false;  ///< the nodes lie at the coordinates of the piece, not on the grid
    bool curved = false;       ///< the nodes lie at the points of the piece
    bool big_endian = false;
    bool wide = false;  ///< sizes have 64 bits
    std::string compressor;
    std::array<std::int64_t, 6> extent{};
    VtkGrid grid;
    Double3 origin{0, 0, 0};
    std::vector<VtiPiece> pieces;  ///< at least one; none is empty
    std::string encoding;          ///< of appended data: "raw" or "base64"
    std::uint64_t appended = 0;    ///< file offset of the byte after the mark
};

/// Reads the XML up to the appended data. Throws Error{corrupt, unsupported, io}.
VtiHeader read_vti_header(const InputFile& file);

// Joins an image that is stored in several pieces in one file.

/// A box of samples (points or cells), in the image's own indices from 0: x, y, z.
struct PieceBox {
    std::array<std::int64_t, 3> low{};
    std::array<std::int64_t, 3> count{};  ///< > 0
};

/// Whether every sample of the image is in at least one box. Also false for boxes that divide the
/// image into more than 100,000 parts.
bool cover(const std::vector<PieceBox>& boxes, const std::array<std::int64_t, 3>& image);

/// Whether a later box contains all samples of this box, so that it can be ignored.
bool is_within_later(const std::vector<PieceBox>& boxes, std::size_t index);

struct PieceNumbers {
    PieceBox box;
    std::unique_ptr<ByteReader> numbers;  ///< of its samples, x fastest
};

/// The bytes of the image, x fastest. Samples in several pieces are taken from the last one.
/// `sample_bytes`: of one sample with all its components. REQUIRES: cover().
std::unique_ptr<ByteReader> join_pieces(std::vector<PieceNumbers> pieces,
                                        const std::array<std::int64_t, 3>& image,
                                        std::uint64_t sample_bytes);

}  // namespace isonest::detail
