// A source that says what its labels are called.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// `inner`, with these names in place of its own, by rising ids; itself if there are none. `table`:
/// the file that they come from, if the inner source does not read it; else empty.
std::unique_ptr<VolumeSource> with_label_names(std::unique_ptr<VolumeSource> inner,
                                               std::vector<LabelName> names,
                                               const std::filesystem::path& table = {});

}  // namespace isonest::detail
