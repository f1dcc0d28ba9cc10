// The anatomical frame of a volume's world coordinates: which way along a patient its axes point.
#pragma once

#include <cstdint>
#include <optional>
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

/// By one of the names above but "unknown", in capital or small letters.
constexpr std::optional<AnatomicalFrame> frame_from(std::string_view name) {
    return name == "RAS" || name == "ras"   ? std::optional(AnatomicalFrame::ras)
           : name == "LPS" || name == "lps" ? std::optional(AnatomicalFrame::lps)
                                            : std::nullopt;
}

/// The sign of x and y when positions in one frame become positions in the other one: -1 where both
/// are known and differ, else 1. z stays. Turning a whole half circle about z, this leaves what is
/// right-handed right-handed.
constexpr int sign_between(AnatomicalFrame from, AnatomicalFrame to) {
    return from != to && from != AnatomicalFrame::unknown && to != AnatomicalFrame::unknown ? -1
                                                                                            : 1;
}

}  // namespace isonest
