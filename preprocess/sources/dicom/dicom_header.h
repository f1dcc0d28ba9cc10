// What the header of a DICOM image says: its numbers, and where its frames lie (PS3.3, C.7.6).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>

#include "preprocess/sources/dicom/dicom_elements.h"

namespace isonest::detail {

/// What tells images of one place apart, in the order in which it counts.
enum class DicomMomentPart : std::uint8_t { time, acquisition, b_value, trigger, echo };
inline constexpr std::size_t kDicomMomentParts = 5;
using DicomMoment = std::array<std::optional<double>, kDicomMomentParts>;

/// What may be said of all frames of a file, or of one. World coordinates are the patient's: x to
/// the left, y to the back, z to the head, millimetres.
struct DicomPlace {
    std::optional<Double3> position = {};  ///< of the first sample
    /// The directions along a row, and along a column.
    std::optional<std::array<Double3, 2>> orientation = {};
    std::optional<std::array<double, 2>> spacing = {};  ///< between columns (x), and rows (y)
    std::optional<double> step = {};                    ///< between slices
    std::optional<double> thickness = {};               ///< of a slice
    std::optional<double> slope = {};
    std::optional<double> intercept = {};
    DicomMoment moment = {};
    std::optional<std::int64_t> segment = {};  ///< of a segmentation: which one this is
};

/// How the numbers are stored.
struct DicomNumbers {
    std::int64_t columns = 0;
    std::int64_t rows = 0;
    int samples = 1;  ///< per pixel
    int allocated = 16;
    int stored = 16;
    int high = 15;  ///< the highest bit
    bool is_signed = false;
    bool floating = false;  ///< of 32 or 64 bits
    int table_bits = 0;     ///< of the values in the table of values; 0: there is none
    int mosaic = 1;         ///< so many frames beside and below each other are one stored image
    /// Of the stored numbers.
    [[nodiscard]] ValueType type() const;
    /// Of what the table makes of them; no smaller than the stored ones.
    [[nodiscard]] ValueType value_type() const;
    /// The image as it is stored, of which a frame may be a part.
    [[nodiscard]] DicomNumbers whole_image() const;
    /// Of `frames` frames. Single bits lie without gaps between frames.
    [[nodiscard]] std::uint64_t bytes_of(std::int64_t frames) const {
        return (static_cast<std::uint64_t>(columns * rows) * static_cast<std::uint64_t>(frames) *
                    static_cast<unsigned>(allocated) +
                7) /
               8;
    }
    [[nodiscard]] std::uint64_t frame_bytes() const { return bytes_of(1); }
    /// "512 x 512 of 12 bits"
    [[nodiscard]] std::string text() const;
    bool operator==(const DicomNumbers&) const = default;
};

/// A table of values (Modality LUT; PS3.3, C.11.1): of stored numbers from `first` on. Smaller ones
/// have the first value, larger ones the last.
struct DicomTable {
    std::int64_t first = 0;
    std::vector<std::uint16_t> values = {};
    std::string type = {};  ///< "HU", "US"
};

/// A segment of a segmentation (PS3.3, C.8.20.4).
struct DicomSegment {
    std::int64_t number = 0;
    std::string label = {};  ///< UTF-8 where the file's character set is that or Latin 1
    std::optional<std::array<std::uint16_t, 3>> lab = {};  ///< CIELab, as it is stored
};

/// What the frames of a segmentation are (PS3.3, C.8.20.2).
struct DicomSegmentation {
    enum class Kind : std::uint8_t {
        none,
        binary,      ///< of each frame one segment, in single bits
        fractional,  ///< of each frame how much of a segment is there, up to `most`
        label_map    ///< values are segments' numbers
    };
    Kind kind = Kind::none;
    double most = 255;
    std::vector<DicomSegment> segments = {};
};

struct DicomHeader {
    std::string instance = {};  ///< SOP instance UID
    std::string series = {};    ///< its UID
    std::string description = {};
    std::string modality = {};
    std::string photometric = {};
    std::optional<std::int64_t> number = {};  ///< in the series
    DicomNumbers numbers = {};
    std::int64_t frames = 1;
    DicomPlace shared = {};
    std::vector<DicomPlace> per_frame = {};  ///< empty, or one for each
    std::vector<double> grid_offsets = {};   ///< dose: of the frames along the normal
    std::vector<double> slice_numbers = {};  ///< nuclear medicine: of each frame
    DicomPlace detector = {};                ///< nuclear medicine: of the first one
    std::optional<double> dose_scaling = {};
    std::optional<std::int64_t> padding = {};  ///< the stored number outside of the image
    DicomTable table = {};                     ///< without values: there is none
    bool localizer = false;                    ///< ImageType says so
    DicomSegmentation segmentation = {};
    /// Slices of a mosaic lie against the normal of rows and columns.
    bool mosaic_backward = false;
    DicomElement pixels = {};  ///< its tag is 0: this is no image
};

/// Fills `header`, as far as it came where it throws. Throws Error{corrupt, io, unsupported}:
/// colours, bits that are no bytes; and Error{limit} where what is said of the frames, one by one,
/// takes more than `most_bytes`. An object of a class that is no image has no pixels; an image
/// without them is corrupt.
void read_dicom_header(DicomFile& file, std::uint64_t most_bytes, DicomHeader& header);

}  // namespace isonest::detail
