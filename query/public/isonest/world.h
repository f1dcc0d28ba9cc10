// Positions in world units: boxes, planes and viewpoints.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest {

/// REQUIRES (checked where it is used): lo < hi along each axis.
struct WorldBox {
    Double3 lo{};
    Double3 hi{};
};

/// How the space outside a volume or box is treated when the surface is closed there.
enum class Outside : std::uint8_t {
    below,  ///< as below the isovalue: the solid is where values are not below it
    above   ///< as not below the isovalue: the solid is where values are below it
};

/// The plane {normal . x = offset}. The normal need not have length 1.
struct WorldPlane {
    Double3 normal{0, 0, 1};
    double offset = 0;
};

/// Inside the box (a point, if lo = hi) the tolerance is as given. Outside, it is multiplied by (1
/// + falloff * distance).
struct Focus {
    Double3 lo{};
    Double3 hi{};
    double falloff = 0;  ///< per world unit, >= 0
};

/// A perspective view. Diamonds that appear smaller than `pixels` are not refined.
struct Camera {
    Double3 position{};
    double field_of_view = 40;  ///< degrees, vertical
    int height = 1080;          ///< pixels, vertical
    double pixels = 1;
};

/// Type of the nested grid's cells.
enum class Cells : std::uint8_t {
    tetrahedra,
    hexahedra  ///< cubes with trilinear interpolation between the corners; for data in a plane,
               ///< squares with bilinear interpolation
};

/// Where a vertex of a surface or isoline is placed on an edge of the nested grid.
enum class VertexPlace : std::uint8_t {
    linear,  ///< linear interpolation between the edge's ends
    /// Where the finest function has the isovalue, at every level: the vertices lie on the surface
    /// at full resolution, except where faces of the volume or a box cut coarse triangles. The
    /// values on the triangles between them are then within twice the error.
    exact
};

}  // namespace isonest
