// Where a stack of slices lies in the world, and what its user should know about that.
#pragma once

#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/int3.h>

#include "preprocess/sources/dicom/dicom_stack.h"
#include "preprocess/sources/placement/placement.h"

namespace isonest::detail {

struct PlacedStack {
    Placement place = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<std::string> notes = {};  ///< what of the file's place is dropped
};

/// `nodes`: of the volume. `spaced`: the caller says the spacing, so that a tilted gantry is no
/// error: its axes then count as the world's, and a note says what that loses. No I/O. Throws as
/// place_in_world(); of a tilted gantry with its angle, the spacing, and what a spacing of the
/// caller's would drop.
PlacedStack place_stack(const Int3& nodes, const DicomStack& stack, bool spaced,
                        const std::string& name);

}  // namespace isonest::detail
