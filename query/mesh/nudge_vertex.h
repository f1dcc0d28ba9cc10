// Moves a vertex by as little as float32 can tell, so that the triangles around it have an area.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include <isonest/int3.h>

namespace isonest::detail {

/// 0 for a triangle with an area, 1 for one that is a segment, 2 for a point.
int missing_dimensions(const std::array<float, 3>& a, const std::array<float, 3>& b,
                       const std::array<float, 3>& c);

/// What a vertex may do at the box around the mesh.
enum class NudgeFreedom : std::uint8_t {
    stay_on_faces,  ///< what lies on a face stays in it; nothing leaves the box
    stay_in_box,
    anywhere
};

struct NudgeRange {
    /// Steps along an axis are units in the last place of the coordinate, but at least this;
    /// world units.
    Double3 least_step{};
    /// The box.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
};

/// A place for the vertex and what it changes.
struct Nudge {
    std::array<float, 3> to{};
    int mended = 0;  ///< dimensions that the triangles gain, > 0
    int turned = 0;  ///< triangles that face against what was around them
    /// Square of the smallest height among the triangles around that have an area then.
    double square_height = 0;
};

/// The corners of a triangle at the vertex: those that come after it.
using OppositeSide = std::array<std::array<float, 3>, 2>;

/// The best place at `steps` steps along at least one axis and no more along any: with the fewest
/// triangles turned, of these with the most dimensions gained, of these with the largest of the
/// smallest heights, of these the first in a fixed order.
/// Nothing if no place gains without a loss elsewhere. `around`: the triangles around the vertex.
std::optional<Nudge> nudged(const std::array<float, 3>& vertex,
                            std::span<const OppositeSide> around, const NudgeRange& range,
                            int steps, NudgeFreedom freedom);

}  // namespace isonest::detail
