// How good an extracted mesh is to be: each way to say it is a type.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>

#include <isonest/field.h>

namespace isonest {

/// What an ErrorBound promises.
enum class Guarantee : std::uint8_t {
    deviation,  ///< |U - U^l| <= value, by the deviation indicator: tight
    plus,       ///< the same, by eta+ of the offset indicator: looser, more triangles
    estimate    ///< eta bar of the offset indicator: usually close, no promise
};

/// How far the function that is shown may be from the finest one, anywhere.
struct ErrorBound {
    double value = 0;       ///< >= 0; 0 = full resolution
    bool relative = false;  ///< value is a fraction of the data's range, not in the data's units
    Guarantee guarantee = Guarantee::deviation;
};

/// In place of an error: nodes at which this field of the store is below the value are not refined.
struct FieldThreshold {
    Field field = Field::deviation_bar;
    double value = 0;       ///< >= 0, in the field's own units
    bool relative = false;  ///< value is a fraction of the field's largest finite value
};

/// The stop test of a traversal.
using StopTest = std::variant<ErrorBound, FieldThreshold>;

/// How much time is spent on leaving few triangles; what is promised is the same.
enum class Effort : std::uint8_t {
    fast,  ///< by a proof that looks at no other part of the surface; more triangles
    best   ///< the fewest triangles that are found
};

/// How far the mesh of a surface may be from the surface at full resolution, anywhere and in both
/// directions (their Hausdorff distance); the triangles or lines are as few as are found within
/// that.
struct DistanceBound {
    double value = 0;     ///< >= 0; 0 = full resolution
    bool voxels = false;  ///< value is in distances of neighbouring nodes (along the axis where
                          ///< they are nearest), not in world units
    Effort effort = Effort::best;  ///< for triangles; isolines have the best one alone
};

/// The smallest distance that is found at which a surface has so few triangles.
struct TriangleBudget {
    std::uint64_t most = 0;  ///< > 0
    /// If a mesh within this distance has more triangles, it is the result.
    std::optional<DistanceBound> within = {};
    Effort effort = Effort::best;  ///< that of `within` says nothing
};

/// The surface at full resolution, simplified.
using DistanceStop = std::variant<DistanceBound, TriangleBudget>;

/// The same distance, kept by elements of the nested grid, which are not simplified: the stop test
/// is the distance of a leaf's triangles, with exact vertices, from the surface at full resolution
/// within the leaf. Elements that the box or the volume's border cuts, and those of more than 32
/// cells along an edge, go on.
struct NestedDistanceBound {
    DistanceBound bound;  ///< its effort says nothing
};

/// The same error, kept by fewer triangles: those that the nested grid has within a part of it are
/// simplified as long as the values on all of the new ones are proven to be within all of it. The
/// topology stays that of the nested grid's surface. Nothing is simplified if the error is 0.
struct SimplifiedErrorBound {
    ErrorBound bound;
};

/// The smallest error that is found at which a surface has so few triangles.
struct ErrorBudget {
    std::uint64_t most = 0;  ///< > 0; or lines
    Guarantee guarantee = Guarantee::deviation;
    bool simplified = false;  ///< the mesh is that of a SimplifiedErrorBound, not of an ErrorBound
};

/// How good a surface is to be, and by what: by the stop test of the traversal alone (ErrorBound,
/// FieldThreshold, NestedDistanceBound, ErrorBudget), or by a simplification of the surface at full
/// resolution (DistanceBound, TriangleBudget) or of the nested grid's (SimplifiedErrorBound).
using SurfaceStop = std::variant<ErrorBound, FieldThreshold, DistanceBound, TriangleBudget,
                                 ErrorBudget, SimplifiedErrorBound, NestedDistanceBound>;

}  // namespace isonest
