// What has to be the same for all ranks before they work together.
#pragma once

#include <filesystem>
#include <string>

#include <isonest/preprocess.h>
#include <isonest/volume_source.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Refuses on rank 0 if ranks see different inputs, or were given different options; the error says
/// which ranks. Collective. Throws Error{invalid_argument}.
void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options);

/// Refuses on rank 0 if a rank does not see what rank 0 has written into the folder of `store`. A
/// network's file system gets some seconds to show it. Collective. Throws Error{io} and
/// Error{invalid_argument}.
void require_same_folder(Communicator& ranks, const std::filesystem::path& store);

}  // namespace isonest::detail
