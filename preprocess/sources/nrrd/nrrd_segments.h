// What 3D Slicer says of the segments of a .seg.nrrd file.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "preprocess/sources/label_names/found_labels.h"

namespace isonest::detail {

/// `keys`: those of the header that begin with "Segment" ("Segment0_Name", "Segment12_Color").
/// Segments of other layers than `layer` are left out, and all where there is none: the volume then
/// has several.
/// Source: https://slicer.readthedocs.io/en/latest/developer_guide/modules/segmentations.html
FoundLabels labels_of_segments(const std::map<std::string, std::string, std::less<>>& keys,
                               std::optional<std::int64_t> layer);

}  // namespace isonest::detail
