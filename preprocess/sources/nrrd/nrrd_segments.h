// What 3D Slicer says of the segments of a .seg.nrrd file.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "preprocess/sources/label_names/found_labels.h"

namespace isonest::detail {

/// `keys`: those of the header that begin with "Segment" ("Segment0_Name", "Segment12_Color").
/// Segments of layers other than 0 are left out: the file then has no such layer.
/// Source: https://slicer.readthedocs.io/en/latest/developer_guide/modules/segmentations.html
FoundLabels labels_of_segments(const std::map<std::string, std::string, std::less<>>& keys);

}  // namespace isonest::detail
