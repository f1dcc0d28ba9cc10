// What the module that reads OpenVDB has for the library, which loads it when such a file is
// opened.
#pragma once

#include "preprocess/sources/volume_format.h"

/// A source that the caller owns; throws as the opening functions of formats do. The module stays
/// loaded from then on.
extern "C" isonest::VolumeSource* isonest_open_vdb(const isonest::detail::VolumeInput& input,
                                                   const isonest::SourceOptions& options);
