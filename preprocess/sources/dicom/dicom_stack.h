// The slices of a DICOM series in the order of their positions in the world (PS3.3, C.7.6.2.1.1:
// the position and the directions of an image).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <isonest/frame.h>
#include <isonest/int3.h>

#include "preprocess/sources/dicom/dicom_series.h"
#include "preprocess/sources/placement/placement.h"

namespace isonest::detail {

struct DicomStack {
    std::int64_t times = 1;  ///< number of images at each place
    std::int64_t count = 1;  ///< number of places
    /// All places of the first time, then of the next.
    std::vector<DicomSlice> slices = {};
    std::array<Double3, 3> steps = {};  ///< in the world: along a row, a column, to the next slice
    Double3 first{0, 0, 0};
    Double3 normal{0, 0, 0};  ///< of the slices' planes; zero if images have no positions
    /// Images have positions: the steps and the first place are in patient coordinates.
    bool placed = false;
    /// The distance of each place from the first along the normal, if they are not even; else
    /// empty.
    std::vector<double> offsets = {};
    std::string times_are = {};  ///< what distinguishes images at one place, for the user
    /// Irregularities, for the user.
    std::vector<std::string> notes = {};
};

/// Sorts by position along the normal; images at one place by time, by what else differs in the
/// same way at all places (acquisition, b value, trigger, echo), by number in the series and by
/// file. If images have no positions, sorts by their numbers, or by file name. `as_it_is`: missing
/// or slices off the line from the first to the last are not errors, because the caller gives their
/// distance. No I/O. Throws Error{unsupported}, naming the files, for images that differ, for
/// slices that are missing or duplicated, and for slices at uneven distances that are also tilted.
DicomStack stack_slices(const DicomGroup& images, const std::vector<std::filesystem::path>& files,
                        bool as_it_is, const std::string& name);

// The place of a stack of slices in the world, and what the user should know about it.

struct PlacedStack {
    Placement place = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    std::vector<std::string> notes = {};  ///< what is dropped of the place in the file
};

/// `nodes`: of the volume. `spaced`: the caller gives the spacing: the axes of a tilted gantry are
/// then taken as the world's, and a note says what is lost. No I/O. Throws like place_in_world().
PlacedStack place_stack(const Int3& nodes, const DicomStack& stack, bool spaced,
                        const std::string& name);

}  // namespace isonest::detail
