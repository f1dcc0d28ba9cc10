// The slices of a DICOM series in the order in which they lie in the world (PS3.3, C.7.6.2.1.1: the
// position and the directions of an image).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/sources/dicom/dicom_series.h"

namespace isonest::detail {

struct DicomStack {
    std::int64_t times = 1;  ///< images at each place
    std::int64_t count = 1;  ///< places
    /// All places of the first time, then of the next.
    std::vector<DicomSlice> slices = {};
    std::array<Double3, 3> steps =
        {};  ///< the world's along a row, a column, and to the next slice
    Double3 first{0, 0, 0};
    Double3 normal{0, 0, 0};  ///< of the slices' planes; none if images do not say where they lie
    bool placed = false;      ///< they do: the steps and the first place are the patient's
    std::string times_are = {};  ///< what tells images of one place apart, for the user
    /// What was not as it should be, for the user.
    std::vector<std::string> notes = {};
};

/// Sorts by the position along the normal; images at one place by their time, by what else differs
/// in the same way at all places (acquisition, b value, trigger, echo), number in the series and
/// file. Where images have no positions, by their numbers, or as the files' names say.
/// `as_it_is`: slices that are missing or at uneven distances are no error, because the caller
/// says how far apart they are. No I/O.
/// Throws Error{unsupported}, which names the files: images that differ, slices that are missing,
/// doubled, or at uneven distances.
DicomStack stack_slices(const DicomGroup& images, const std::vector<std::filesystem::path>& files,
                        bool as_it_is, const std::string& name);

}  // namespace isonest::detail
