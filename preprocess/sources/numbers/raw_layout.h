// Where numbers lie in a file, and how.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

/// Whether the numbers are compressed: as their first bytes say (of a file that nothing describes),
/// or as a header says, which these must then agree with.
enum class Packing { recognised, plain, gzip, zlib, deflate };

/// Where and how the numbers lie: behind `start` bytes and `lines` lines of the file as it is
/// stored, and `offset` bytes of what is decompressed from there.
struct RawLayout {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::u8;
    bool big_endian = false;
    Packing packing = Packing::recognised;
    std::uint64_t start = 0;
    std::uint64_t lines = 0;
    std::uint64_t offset = 0;
    bool offset_from_end = false;  ///< the data are the last bytes of the file (not with gzip)
    bool exact_length = true;      ///< bytes behind the data are an error
    /// Of a larger array (components of a vector, time steps, another order of its axes): values
    /// from a node to the next along x, y and z, each > 0. None: x fastest, without gaps.
    std::optional<Int3> strides = {};
    /// strides and `first` are bytes, not values; of files here that are not packed.
    bool strides_in_bytes = false;
    std::uint64_t first = 0;  ///< values of that array before node (0, 0, 0)
    std::uint64_t whole = 0;  ///< values of that array; 0: as many as nodes
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    InputFile header;                    ///< what describes them, if it is another file
    std::vector<InputFile> others = {};  ///< further files with numbers
};

}  // namespace isonest::detail
