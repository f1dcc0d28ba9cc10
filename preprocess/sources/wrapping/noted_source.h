// A source with more to say than its numbers.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// `inner`, with these notes behind its own; itself if there are none.
std::unique_ptr<VolumeSource> with_notes(std::unique_ptr<VolumeSource> inner,
                                         std::vector<std::string> notes);

}  // namespace isonest::detail
