// The note about a spacing that no file says.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// The note for a volume whose file does not say the spacing along all of its axes, so that it was
/// taken as 1. `said`: whether it does, along x, y and z. Empty where it does, or the caller gives
/// a spacing; axes of one node need none.
std::vector<std::string> note_of_spacing(const std::array<bool, 3>& said, const Int3& nodes,
                                         const SourceOptions& options);

/// `inner`, whose file says no spacing at all, with that note.
std::unique_ptr<VolumeSource> without_spacing(std::unique_ptr<VolumeSource> inner,
                                              const SourceOptions& options);

}  // namespace isonest::detail
