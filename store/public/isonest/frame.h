// The anatomical frame of a volume's world coordinates: which way along a patient its axes point.
#pragma once

#include <cstdint>
#include <string_view>

namespace isonest {

/// What the world's x, y and z mean. The letters say to which side of the patient each of them
/// increases: R(ight) or L(eft), A(nterior) or P(osterior), S(uperior). NIfTI and FreeSurfer have
/// RAS, DICOM and ITK LPS. A position in one becomes the same position in the other by negating its
/// x and y.
enum class AnatomicalFrame : std::uint8_t {
    unknown,  ///< nothing says it, or the volume is of no patient
    ras,
    lps
};

/// "unknown", "RAS", "LPS".
constexpr std::string_view name_of(AnatomicalFrame frame) {
    return frame == AnatomicalFrame::ras   ? "RAS"
           : frame == AnatomicalFrame::lps ? "LPS"
                                           : "unknown";
}

}  // namespace isonest
