// The anatomical frame of a volume's world coordinates: in which direction along a patient the axes
// point.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace isonest {

/// Meaning of the world's x, y and z. The letters give the side of the patient towards which each
/// of them increases: R(ight) or L(eft), A(nterior) or P(osterior), S(uperior). NIfTI and
/// FreeSurfer use RAS, DICOM and ITK use LPS. Negating x and y converts a position from one to the
/// other.
enum class AnatomicalFrame : std::uint8_t {
    unknown,  ///< not specified, or the volume is not of a patient
    ras,
    lps
};

/// "unknown", "RAS", "LPS".
constexpr std::string_view name_of(AnatomicalFrame frame) {
    return frame == AnatomicalFrame::ras   ? "RAS"
           : frame == AnatomicalFrame::lps ? "LPS"
                                           : "unknown";
}

/// The frame of one of these names except "unknown", in capital or small letters.
constexpr std::optional<AnatomicalFrame> frame_from(std::string_view name) {
    return name == "RAS" || name == "ras"   ? std::optional(AnatomicalFrame::ras)
           : name == "LPS" || name == "lps" ? std::optional(AnatomicalFrame::lps)
                                            : std::nullopt;
}

/// The sign of x and y when positions are converted between frames: -1 if both are known and
/// differ, else 1. z does not change. The conversion is a rotation by 180 degrees about z, so
/// handedness is preserved.
constexpr int sign_between(AnatomicalFrame from, AnatomicalFrame to) {
    return from != to && from != AnatomicalFrame::unknown && to != AnatomicalFrame::unknown ? -1
                                                                                            : 1;
}

}  // namespace isonest
