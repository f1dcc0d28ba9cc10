// Between which volumes that of the solid at full resolution lies.
#pragma once

#include <isonest/extract.h>

namespace isonest::detail {

/// Of the solid that `query` closes. `tolerance`: the error of its stop, in units of the data.
/// Nothing if it cannot be closed, at missing values. Throws as extract().
/// REQUIRES: the wishes of the query go together with an interval of the volume, which it does not
/// ask for itself.
std::optional<VolumeInterval> volume_interval(const Store& store, const SurfaceQuery& query,
                                              double tolerance, const ExtractOptions& options,
                                              Progress& progress);

}  // namespace isonest::detail
