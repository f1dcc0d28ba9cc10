// Which DICOM images belong together: those of a series, and what they have in common.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/sources/dicom/dicom_header.h"

namespace isonest::detail {

/// A frame of a file.
struct DicomSlice {
    std::uint32_t file = 0;
    std::uint32_t frame = 0;
    std::optional<Double3> position = {};  ///< of the first sample, in the world
    double slope = 1;                      ///< value = slope * stored + intercept
    double intercept = 0;
    std::optional<std::int64_t> number = {};  ///< of the image in the series
    std::int64_t time = 0;
    std::uint64_t instance = 0;  ///< tells images from copies of them: a digest of their UID
};

struct DicomSeries {
    std::string uid = {};
    std::string description = {};
    std::string modality = {};
    DicomNumbers numbers = {};
    std::optional<std::array<Double3, 2>> orientation = {};  ///< along rows and columns
    std::optional<std::array<double, 2>> spacing = {};       ///< along rows and columns
    std::optional<double> step = {};                         ///< between slices, as the file says
    bool dark_is_large = false;                              ///< MONOCHROME1
    bool has_modality_table = false;
    std::optional<std::int64_t> padding = {};
    std::vector<DicomSlice> slices = {};  ///< as they were found
    std::string difference = {};          ///< what one of them has of its own, if any
};

struct DicomFolder {
    std::vector<DicomSeries> series = {};
    std::int64_t others = 0;  ///< files that are no DICOM, or no images
};

inline constexpr std::size_t kMostDicomSlices = 500000;

/// Reads the headers of all files. Throws Error{corrupt, io, unsupported}, also where a file cannot
/// be read as the image that it is, and Error{limit} beyond kMostDicomSlices, or where what is kept
/// of them takes more than `max_heap` bytes and some MiB.
DicomFolder find_dicom_series(const std::vector<std::filesystem::path>& files,
                              std::uint64_t max_heap);

/// The one that `wanted` names by its UID or an ending of it, or the only one, if it is empty.
/// Throws Error{invalid_argument, not_found}, which list them; `name` is used in messages.
const DicomSeries& choose_series(const std::vector<DicomSeries>& series, const std::string& wanted,
                                 const std::string& name);

}  // namespace isonest::detail
