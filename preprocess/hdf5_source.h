// A volume in an HDF5 dataset.
#pragma once

#include <memory>

#include "preprocess/volume_source.h"

namespace isonest {

/// See open_volume().
std::unique_ptr<VolumeSource> open_hdf5_volume(const std::filesystem::path& path,
                                               const SourceOptions& options);

}  // namespace isonest
