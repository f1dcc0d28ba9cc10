// The header of a DICOM image: its numbers, and where its frames lie (PS3.3, C.7.6).
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

/// What distinguishes images at the same place, in order of priority.
enum class DicomMomentPart : std::uint8_t { time, acquisition, b_value, trigger, echo };
inline constexpr std::size_t kDicomMomentParts = 5;
using DicomMoment = std::array<std::optional<double>, kDicomMomentParts>;

/// What can be given for all frames of a file, or for one. World coordinates are the patient's: x
/// to the left, y to the back, z to the head, in millimetres.
struct DicomPlace {
    std::optional<Double3> position = {};  ///< of the first sample
    /// The directions along a row and along a column.
    std::optional<std::array<Double3, 2>> orientation = {};
    /// Between columns (x) and between rows (y).
    std::optional<std::array<double, 2>> spacing = {};
    std::optional<double> step = {};       ///< between slices
    std::optional<double> thickness = {};  ///< of a slice
    std::optional<double> slope = {};
    std::optional<double> intercept = {};
    DicomMoment moment = {};
    std::optional<std::int64_t> segment = {};  ///< of a segmentation: the segment of this frame
};

/// How the numbers are stored.
struct DicomNumbers {
    std::int64_t columns = 0;
    std::int64_t rows = 0;
    int samples = 1;  ///< per pixel
    int allocated = 16;
    int stored = 16;
    int high = 15;  ///< number of the highest bit
    bool is_signed = false;
    bool floating = false;  ///< 32 or 64 bits
    int table_bits = 0;     ///< bits of the values in the lookup table; 0: there is none
    int mosaic = 1;         ///< one stored image is a grid of mosaic x mosaic frames
    /// The type of the stored numbers.
    [[nodiscard]] ValueType type() const;
    /// The type of the values after the lookup table; at least as wide as the stored one.
    [[nodiscard]] ValueType value_type() const;
    /// The stored image, of which a frame may be a part.
    [[nodiscard]] DicomNumbers whole_image() const;
    /// Bytes of `frames` frames. Single bits are stored without gaps between frames.
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

/// A lookup table of values (Modality LUT; PS3.3, C.11.1) for stored numbers from `first` on.
/// Smaller numbers map to the first value, larger ones to the last.
struct DicomTable {
    std::int64_t first = 0;
    std::vector<std::uint16_t> values = {};
    std::string type = {};  ///< "HU", "US"
};

/// A segment of a segmentation (PS3.3, C.8.20.4).
struct DicomSegment {
    std::int64_t number = 0;
    std::string label = {};  ///< UTF-8 if the file's character set is UTF-8 or Latin 1
    std::optional<std::array<std::uint16_t, 3>> lab = {};  ///< CIELab, as stored
};

/// The kind of frames in a segmentation (PS3.3, C.8.20.2).
struct DicomSegmentation {
    enum class Kind : std::uint8_t {
        none,
        binary,      ///< each frame has one segment, in single bits
        fractional,  ///< each frame has the fraction of one segment, up to `most`
        label_map    ///< values are segment numbers
    };
    Kind kind = Kind::none;
    double most = 255;
    std::vector<DicomSegment> segments = {};
};

struct DicomHeader {
    std::string instance = {};  ///< SOP instance UID
    std::string series = {};    ///< series instance UID
    std::string description = {};
    std::string modality = {};
    std::string photometric = {};
    std::optional<std::int64_t> number = {};  ///< in the series
    DicomNumbers numbers = {};
    std::int64_t frames = 1;
    DicomPlace shared = {};
    std::vector<DicomPlace> per_frame = {};  ///< empty, or one for each frame
    std::vector<double> grid_offsets = {};   ///< dose: position of each frame along the normal
    std::vector<double> slice_numbers = {};  ///< nuclear medicine: for each frame
    DicomPlace detector = {};                ///< nuclear medicine: place of the first detector
    std::optional<double> dose_scaling = {};
    std::optional<std::int64_t> padding = {};  ///< the stored number outside of the image
    DicomTable table = {};                     ///< without values: there is no table
    bool localizer = false;                    ///< according to ImageType
    DicomSegmentation segmentation = {};
    /// Slices of a mosaic are stacked against the normal of rows and columns.
    bool mosaic_backward = false;
    DicomElement pixels = {};  ///< tag 0: not an image
};

/// Fills `header`, partially if it throws. Throws Error{corrupt, io, unsupported} (colours, bits
/// that do not fill bytes), and Error{limit} if the per-frame data take more than `max_bytes`. An
/// object of a class that is not an image has no pixels; an image without pixels is corrupt.
void read_dicom_header(DicomFile& file, std::uint64_t max_bytes, DicomHeader& header);

}  // namespace isonest::detail
