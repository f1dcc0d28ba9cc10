// What the surface looks like in a hexahedral cell, a cube marched as a whole.
//
// Sources: W. Lorensen, H. Cline, "Marching cubes", SIGGRAPH 1987. Where the corners of a face are
// on alternate sides, the surface cuts off the two that are below: a rule from the signs on the
// face alone, as C. Montani, R. Scateni, R. Scopigno, "A modified look-up table for implicit
// disambiguation of marching cubes", The Visual Computer 10 (1994), so that both cells at the face
// agree. Derived from the rule when first used.
#pragma once

#include <array>
#include <cstdint>

#include "query/march/cube_cases.h"

namespace isonest::detail {

/// The surface in a cell is a set of polygons, each with a corner on each cube edge that it
/// crosses, and its sides in the cube's faces. Faces are numbered 2 axis + (0 low, 1 high).
struct HexahedronCase {
    std::uint8_t edges = 0;  ///< that the surface crosses
    /// Positions in kCubeEdge, seen from the low corner; polygon after polygon, each
    /// counterclockwise seen from the smaller values.
    std::array<std::uint8_t, 12> edge{};
    /// The face in which the side lies that begins there.
    std::array<std::uint8_t, 12> face{};
    std::uint8_t polygons = 0;
    std::array<std::uint8_t, 5> first{};  ///< where each begins, and after the last one `edges`
    std::uint8_t triangles = 0;
    /// Corners as positions in `edge`. No side of a triangle but the polygon's own lies in a face.
    std::array<std::array<std::uint8_t, 3>, 10> triangle{};
};

/// By the corners below the isovalue (bits 0 to 7), seen from the low one.
using HexahedronCases = std::array<HexahedronCase, 256>;
const HexahedronCases& hexahedron_cases();

/// A face's corners, counterclockwise seen from outside.
std::array<unsigned, 4> corners_of_face(unsigned face);

/// Bits of the cube's faces in which a corner, or the edge between two corners, lies.
constexpr unsigned faces_at(unsigned corner) {
    unsigned faces = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        faces |= 1U << (2 * axis + (corner >> axis & 1U));
    }
    return faces;
}
constexpr unsigned faces_at(const CubeEdge& edge) {
    return faces_at(edge.low) & faces_at(edge.high);
}

}  // namespace isonest::detail
