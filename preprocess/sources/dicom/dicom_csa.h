// The private header that Siemens puts into MR images (CSA): a table of tags with texts. The layout
// is not published; sources: nibabel.nicom.csareader, SPM, dcm2niix.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include <isonest/int3.h>

namespace isonest::detail {

/// An image whose plane is a square of slices, from left to right and from top to bottom.
struct SiemensMosaic {
    std::int64_t images = 0;             ///< slices; the rest of the square is empty
    std::optional<Double3> normal = {};  ///< from a slice to the next
};

/// What (0029,xx10) of "SIEMENS CSA HEADER" says; none where it says no number of images or is
/// damaged. No count in it is believed before its bytes are there. No I/O.
std::optional<SiemensMosaic> mosaic_of_csa(std::string_view csa);

}  // namespace isonest::detail
