// Fewer triangles for a patch, on none of which the data are further from the isovalue than an
// error.
//
// Edges are collapsed one after the other (query/simplify/collapse/collapse_stars.h), each only
// after the triangles that it makes were proven to be within the error
// (query/simplify/by_value/value_cover.h). The order plays no part in that.
//
// A cap of a closed surface is no isosurface; there it counts what the cap leaves out or takes in.
// A collapse inside of a cap covers what was covered, since nothing turns over. One at the line
// where surface and cap meet moves this line over triangles, and these have to be within the error.
#pragma once

#include <vector>

#include "query/simplify/by_value/value_cover.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

struct ValuePatch {
    std::vector<PatchTriangle> triangles;
    std::vector<bool> tried;  ///< as in the patch, for the pass that comes
    double largest = 0;       ///< |U - iso| was not larger on any triangle that was made
};

/// Heap per triangle of a patch, at most, that simplify_patch_by_value() takes, the patch included.
inline constexpr std::size_t kValuePatchBytesPerTriangle = 800;

/// `has_caps`: whether triangles that lie in a face of the patch's box are caps; other triangles
/// may lie anywhere. The patch's `stay`, `fine` and `servers` are not looked at. Thread-safe, with
/// different `cover`.
ValuePatch simplify_patch_by_value(const Patch& patch, bool has_caps, ValueCover& cover);

}  // namespace isonest::detail
