// Which DICOM images belong together: those of a series, and what they have in common.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

/// A frame of a file.
struct DicomSlice {
    std::uint32_t file = 0;
    std::uint32_t frame = 0;
    std::optional<Double3> position = {};  ///< of the first sample, in the world
    double slope = 1;                      ///< value = slope * stored + intercept
    double intercept = 0;
    std::optional<std::int64_t> number = {};            ///< of the image in the series
    std::array<double, kDicomMomentParts> moment = {};  ///< -infinity for what is not said
    std::uint16_t segment = 0;   ///< of a segmentation: which one; 0: not said
    std::uint64_t instance = 0;  ///< tells images from others: a digest of their UID; 0: none
};

/// Images of a series that may be one volume: of the same numbers, direction and spacing. A series
/// has several where a localizer lies in it. Its user knows them as stacks.
struct DicomGroup {
    DicomNumbers numbers = {};
    std::optional<std::array<Double3, 2>> orientation = {};  ///< along rows and columns
    std::optional<std::array<double, 2>> spacing = {};       ///< along rows and columns
    std::optional<double> step = {};                         ///< between slices, as the file says
    /// SpacingBetweenSlices, where the file has it; the thickness of slices may be another.
    std::optional<double> between = {};
    std::shared_ptr<const DicomSegmentation> segmentation = nullptr;  ///< null: it is none
    bool localizer = false;
    bool dark_is_large = false;   ///< MONOCHROME1
    std::string table_type = {};  ///< of the table of values, if there is one
    std::optional<std::int64_t> padding = {};
    std::vector<DicomSlice> slices = {};  ///< as they were found
};

/// Files of a series that are not read.
struct DicomRefused {
    std::int64_t files = 0;
    std::shared_ptr<const Error> first = nullptr;  ///< of the first one
};

struct DicomSeries {
    std::string uid = {};
    std::string description = {};
    std::string modality = {};
    std::vector<DicomGroup> groups = {};  ///< the largest first
    DicomRefused unsupported = {};        ///< sound, but no scalar images: colours
    DicomRefused damaged = {};
    std::int64_t copies = 0;      ///< files that were left out as exact copies
    std::string first_copy = {};  ///< one of them
};

struct DicomFolder {
    std::vector<DicomSeries> series = {};
    std::int64_t others = 0;  ///< files that are no DICOM, or no images
};

inline constexpr std::size_t kMostDicomSlices = 500000;

/// Reads the headers of all files. What is wrong with a file that says its series is kept with that
/// series. Throws Error{corrupt, io, unsupported} for a file that does not say it and cannot be
/// read as the image that it is, and Error{limit} beyond kMostDicomSlices, or where what is kept of
/// them takes more than `max_heap` bytes and some MiB.
DicomFolder find_dicom_series(const std::vector<std::filesystem::path>& files,
                              std::uint64_t max_heap);

/// The one that `wanted` names by its UID or an ending of it; if it is empty, the only one, or the
/// only one that has scalar images. Throws Error{invalid_argument, not_found}, which list them;
/// `name` is used in messages.
DicomSeries& choose_series(std::vector<DicomSeries>& series, const std::string& wanted,
                           const std::string& name);

/// Leaves out files that hold the same object as another one. Throws Error{unsupported} for files
/// of one SOP instance UID that differ, and Error{io}.
void drop_copies(DicomSeries& series, const std::vector<std::filesystem::path>& files);

/// The group of number `stack`, or the only one. `files`: those of the slices. Throws what is wrong
/// with the series' files, and Error{unsupported, invalid_argument}, which list the groups.
const DicomGroup& choose_group(const DicomSeries& series, std::optional<std::int64_t> stack,
                               const std::vector<std::filesystem::path>& files,
                               const std::string& name);

/// What of the series and of the folder is left out if `chosen` is taken, for the user.
std::vector<std::string> notes_of_left_out(const DicomFolder& folder, const DicomSeries& series,
                                           const DicomGroup& chosen,
                                           const std::vector<std::filesystem::path>& files);

}  // namespace isonest::detail
