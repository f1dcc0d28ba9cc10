// What is asked for in the world, in the axes of a rotated volume.
#pragma once

#include <isonest/extract.h>

#include "store/container/format.h"

namespace isonest::detail {

/// The volume's own axes are turned about its origin from those of the world: in them it lies as an
/// unrotated one, and a mesh of it is turned into the world by RotatedSink. A focus that is a box
/// becomes the smallest box along the axes that holds it.
/// Throws Error{unsupported} for what cannot be turned: boxes, graphs. `name`: of the store.
SurfaceQuery in_own_axes(SurfaceQuery query, const StoreHeader& header, const std::string& name);
LabelQuery in_own_axes(LabelQuery query, const StoreHeader& header, const std::string& name);
SliceQuery in_own_axes(SliceQuery query, const StoreHeader& header, const std::string& name);
ContourQuery in_own_axes(ContourQuery query, const StoreHeader& header, const std::string& name);
GraphQuery in_own_axes(const GraphQuery& query, const StoreHeader& header, const std::string& name);

/// The same of a plane.
WorldPlane in_own_axes(const WorldPlane& plane, const StoreHeader& header);

}  // namespace isonest::detail
