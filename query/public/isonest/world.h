// Places in world units: boxes, planes, and where somebody looks from.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest {

/// REQUIRES (checked where it is used): lo < hi along each axis.
struct WorldBox {
    Double3 lo{};
    Double3 hi{};
};

/// What lies outside of a volume, or of a box in it, if the surface is to be closed there.
enum class Outside : std::uint8_t {
    below,  ///< counts as below the isovalue: what is not below it becomes a solid
    above   ///< counts as not below it: what is below it becomes a solid
};

/// The plane {normal . x = offset}. The normal need not have length 1.
struct WorldPlane {
    Double3 normal{0, 0, 1};
    double offset = 0;
};

/// Within the box (a point, if lo = hi) the tolerance is as given; outside it grows with the
/// distance, to (1 + falloff distance) times.
struct Focus {
    Double3 lo{};
    Double3 hi{};
    double falloff = 0;  ///< per world unit, >= 0
};

/// A perspective view. Diamonds of elements that it shows smaller than `pixels` are not refined.
struct Camera {
    Double3 position{};
    double field_of_view = 40;  ///< degrees, from the top of the picture to its bottom
    int height = 1080;          ///< pixels, from the top of the picture to its bottom
    double pixels = 1;
};

/// What the nested grid's cells are.
enum class Cells : std::uint8_t {
    tetrahedra,
    hexahedra  ///< cubes; the function in them is trilinear between the corners. Of data in a
               ///< plane squares, and bilinear
};

/// Where a surface, or isoline, crosses an edge of the nested grid.
enum class VertexPlace : std::uint8_t {
    linear,  ///< linear between the edge's ends
    /// Where the finest function has the isovalue, whatever the level: the vertices lie on the
    /// surface at full resolution (but for those that faces of the volume or a box cut out of
    /// coarse triangles). The values of the triangles between them are then within twice
    /// the error.
    exact
};

}  // namespace isonest
