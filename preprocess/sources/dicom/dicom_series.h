// Groups DICOM images that belong together: those of a series, and what they have in common.
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
    std::array<double, kDicomMomentParts> moment = {};  ///< -infinity for parts that are not given
    std::uint16_t segment = 0;   ///< of a segmentation: the segment; 0: not given
    std::uint64_t instance = 0;  ///< digest of the SOP instance UID, to tell images apart; 0: none
};

/// Images of a series that can form one volume: with the same numbers, direction and spacing. A
/// series has several groups if it contains a localizer, for example. The user sees them as stacks.
struct DicomGroup {
    DicomNumbers numbers = {};
    std::optional<std::array<Double3, 2>> orientation = {};  ///< along rows and columns
    std::optional<std::array<double, 2>> spacing = {};       ///< along rows and columns
    /// Between slices, as given in the file.
    std::optional<double> step = {};
    /// SpacingBetweenSlices, if the file has it; it may differ from the slice thickness.
    std::optional<double> between = {};
    std::shared_ptr<const DicomSegmentation> segmentation = nullptr;  ///< null: not a segmentation
    bool localizer = false;
    bool dark_is_large = false;   ///< MONOCHROME1
    std::string table_type = {};  ///< of the lookup table, if there is one
    std::optional<std::int64_t> padding = {};
    std::vector<DicomSlice> slices = {};  ///< in the order in which they were found
};

/// Files of a series that are not read.
struct DicomRefused {
    std::int64_t files = 0;
    std::shared_ptr<const Error> first = nullptr;  ///< the error of the first one
};

struct DicomSeries {
    std::string uid = {};
    std::string description = {};
    std::string modality = {};
    std::vector<DicomGroup> groups = {};  ///< largest first
    DicomRefused unsupported = {};        ///< valid, but not scalar images: colours
    DicomRefused damaged = {};
    std::int64_t copies = 0;      ///< number of files left out as exact copies
    std::string first_copy = {};  ///< one of them
};

struct DicomFolder {
    std::vector<DicomSeries> series = {};
    std::int64_t others = 0;  ///< files that are not DICOM, or not images
};

inline constexpr std::size_t kMaxDicomSlices = 500000;

/// Reads the headers of all files. A problem with a file whose series is known is kept with that
/// series. Throws Error{corrupt, io, unsupported} for an image that cannot be read and gives no
/// series, and Error{limit} for more than kMaxDicomSlices slices, or if what is kept of them takes
/// more than `max_heap` bytes and some MiB.
DicomFolder find_dicom_series(const std::vector<std::filesystem::path>& files,
                              std::uint64_t max_heap);

/// The series that `wanted` names by its UID or the end of it; if `wanted` is empty, the only
/// series, or the only one with scalar images. Throws Error{invalid_argument, not_found}, listing
/// the series; `name` is used in messages.
DicomSeries& choose_series(std::vector<DicomSeries>& series, const std::string& wanted,
                           const std::string& name);

/// Removes files that hold the same object as another one. Throws Error{unsupported} for files with
/// the same SOP instance UID that differ, and Error{io}.
void drop_copies(DicomSeries& series, const std::vector<std::filesystem::path>& files);

/// The group with number `stack`, or the only one. `files`: those of the slices. Throws the error
/// of the series' refused files, and Error{unsupported, invalid_argument}, listing the groups.
const DicomGroup& choose_group(const DicomSeries& series, std::optional<std::int64_t> stack,
                               const std::vector<std::filesystem::path>& files,
                               const std::string& name);

/// What is left out of the series and the folder if `chosen` is read, for the user.
std::vector<std::string> notes_of_left_out(const DicomFolder& folder, const DicomSeries& series,
                                           const DicomGroup& chosen,
                                           const std::vector<std::filesystem::path>& files);

}  // namespace isonest::detail
