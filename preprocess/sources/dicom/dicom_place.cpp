#include "preprocess/sources/dicom/dicom_place.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

Double3 minus(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

/// What a tilted gantry does to a stack.
struct DicomTilt {
    double degrees = 0;   ///< between the way from slice to slice and the normal of the slices
    double distance = 0;  ///< of neighbouring slices along the normal
    double shift = 0;     ///< of the last slice against the first, in their planes
};

DicomTilt tilt_of(const DicomStack& stack) {
    const Double3& step = stack.steps[2];
    const Double3& n = stack.normal;
    DicomTilt tilt;
    tilt.distance = step[0] * n[0] + step[1] * n[1] + step[2] * n[2];
    const Double3 aside =
        minus(step, {n[0] * tilt.distance, n[1] * tilt.distance, n[2] * tilt.distance});
    const double shift = std::hypot(aside[0], aside[1], aside[2]);
    constexpr double kDegrees = 180 / std::numbers::pi;
    tilt.degrees = std::atan2(shift, std::fabs(tilt.distance)) * kDegrees;
    tilt.shift = shift * static_cast<double>(stack.count - 1);
    return tilt;
}

}  // namespace

PlacedStack place_stack(const Int3& nodes, const DicomStack& stack, bool spaced,
                        const std::string& name) {
    PlacedStack result;
    const DicomTilt tilt = stack.placed ? tilt_of(stack) : DicomTilt{};
    const Double3 spacing{std::hypot(stack.steps[0][0], stack.steps[0][1], stack.steps[0][2]),
                          std::hypot(stack.steps[1][0], stack.steps[1][1], stack.steps[1][2]),
                          std::fabs(tilt.distance)};
    constexpr double kMostShift = 0.1;  // of a voxel, as place_in_world() has it
    const bool tilted =
        stack.placed && tilt.shift >= kMostShift * std::min({spacing[0], spacing[1], spacing[2]});
    result.frame = stack.placed ? AnatomicalFrame::lps : AnatomicalFrame::unknown;
    try {
        result.place = place_in_world(nodes, stack.steps, stack.first, name);
        return result;
    } catch (const Error& error) {
        if (!spaced && (error.kind() != ErrorKind::unsupported || !tilted)) {
            throw;
        }
    }
    if (!spaced) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("a sheared volume (a tilted gantry): its slices are tilted by {:.1f} "
                        "degrees; the spacing is {:.6g},{:.6g},{:.6g}, of slices along their "
                        "normal. A spacing of your own drops the tilt, and the last slice then "
                        "lies {:.4g} beside its place",
                        tilt.degrees, spacing[0], spacing[1], spacing[2], tilt.shift),
            {{RemedyKind::place_in_world, "spacing"}});
    }
    // The axes are taken for the world's; these are the patient's only if they were before.
    result.place.origin = stack.first;
    const std::array<Double3, 3> axes{stack.steps[0], stack.steps[1], stack.normal};
    for (std::size_t a = 0; a < 3; ++a) {
        const Double3& v = axes.at(a);
        if (!(v.at(a) > (1 - 1e-6) * std::hypot(v[0], v[1], v[2]))) {
            result.frame = AnatomicalFrame::unknown;
        }
    }
    if (tilted) {
        result.notes.push_back(fmt::format(
            "the tilt of its slices by {:.1f} degrees is dropped{}, so that the last slice lies "
            "{:.4g} beside its place; the file's spacing is {:.6g},{:.6g},{:.6g}",
            tilt.degrees,
            result.frame == AnatomicalFrame::lps ? "" : ", and so are the directions of its axes",
            tilt.shift, spacing[0], spacing[1], spacing[2]));
    }
    return result;
}

}  // namespace isonest::detail
