// The text header of NRRD files.
#pragma once

#include <array>
#include <string>
#include <string_view>

#include "preprocess/raw_source.h"

namespace isonest {

struct NrrdHeader {
    RawLayout layout;
    bool gzip = false;
    std::int64_t byte_skip = 0;  ///< -1: the data are the last bytes
    std::string data_file;       ///< empty: the data follow the header
    std::uint64_t header_bytes = 0;
    /// Axes that run toward smaller world coordinates; the layout's origin is their low end's.
    std::array<bool, 3> backward{};
    /// Axes that are not along the world's: spacing and origin are not known.
    bool oblique = false;
};

/// Parses the start of an NRRD file. Source: http://teem.sourceforge.net/nrrd/format.html
/// Throws Error{corrupt, unsupported}; `name` is used in messages. No I/O.
NrrdHeader parse_nrrd_header(std::string_view text, const std::string& name);

}  // namespace isonest
