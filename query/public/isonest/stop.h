// Types that specify the accuracy of an extracted mesh.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>

#include <isonest/field.h>

namespace isonest {

/// Which stored field keeps the error of an ErrorBound.
enum class ErrorIndicator : std::uint8_t {
    deviation,  ///< |U - U^l| <= value, by the deviation indicator: tight
    plus,       ///< the same guarantee, by eta+ of the offset indicator: looser, more triangles
    estimate  ///< eta bar of the offset indicator: usually close, no guarantee; in a store without
              ///< linf_bar the same as deviation
};

using Guarantee [[deprecated("now called ErrorIndicator")]] = ErrorIndicator;

/// Maximum difference between the displayed function and the finest one, anywhere.
struct ErrorBound {
    double value = 0;       ///< >= 0; 0 = full resolution
    bool relative = false;  ///< value is a fraction of the data's range, not in the data's units
    ErrorIndicator indicator = ErrorIndicator::deviation;
};

/// Instead of an error: nodes at which this field of the store is below the value are not refined.
struct FieldThreshold {
    Field field = Field::deviation_bar;
    double value = 0;       ///< >= 0, in the field's own units
    bool relative = false;  ///< value is a fraction of the field's largest finite value
};

/// The stop test of a traversal.
using StopTest = std::variant<ErrorBound, FieldThreshold>;

/// How much time is spent on reducing triangles; the guarantee is the same.
enum class Effort : std::uint8_t {
    none,  ///< the elements of the nested grid, unchanged (as in the paper)
    fast,  ///< simplified in the shortest time; more triangles
    best   ///< simplified to the fewest triangles found
};

/// Maximum distance between the mesh and the surface at full resolution, anywhere and in both
/// directions (Hausdorff distance). The surface at full resolution is simplified.
///
/// Without simplification (Effort::none), the stop test is the distance between a leaf's triangles,
/// with exact vertices, and the surface at full resolution within the leaf. Elements that are cut
/// by the box or by the volume's border, and those of more than 32 cells along an edge, are always
/// refined.
struct DistanceBound {
    double value = 0;     ///< >= 0; 0 = full resolution: the same mesh for every Effort
    bool voxels = false;  ///< value is a multiple of the smallest distance between neighbouring
                          ///< nodes along an axis, not in world units
};

/// The smallest distance that is found for which the surface has at most this many triangles.
struct TriangleBudgetByDistance {
    std::uint64_t most = 0;  ///< > 0
    /// If a mesh within this distance has more triangles, it is the result.
    std::optional<DistanceBound> within = {};
};

using TriangleBudget [[deprecated("now called TriangleBudgetByDistance")]] =
    TriangleBudgetByDistance;

using DistanceStop = std::variant<DistanceBound, TriangleBudgetByDistance>;

/// The smallest error that is found for which the surface has at most this many triangles.
struct TriangleBudgetByError {
    std::uint64_t most = 0;  ///< > 0; triangles or lines
    ErrorIndicator indicator = ErrorIndicator::deviation;
};

using ErrorBudget [[deprecated("now called TriangleBudgetByError")]] = TriangleBudgetByError;

/// The accuracy of a surface. If a surface with an ErrorBound or TriangleBudgetByError is
/// simplified, the values on all new triangles are proven to be within the error, and the topology
/// is preserved. The input of the simplification is the nested grid's mesh within a part of the
/// error, or the surface of hexahedra at full resolution.
///
/// Values are those of the function that is linear on each finest tetrahedron, or trilinear on each
/// finest hexahedron. Triangles of hexahedra that remain unchanged from full resolution have the
/// isovalue where they cross the edges of cells; in between their error is not limited, and is
/// reported separately (ErrorSimplificationReport::full_bound).
using SurfaceStop = std::variant<ErrorBound, FieldThreshold, DistanceBound,
                                 TriangleBudgetByDistance, TriangleBudgetByError>;

}  // namespace isonest
