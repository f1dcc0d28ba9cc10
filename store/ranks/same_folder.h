// Whether all ranks see the folder into which they write together.
#pragma once

#include <filesystem>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Refuses on rank 0 if a rank does not see what rank 0 has written into the folder of `output`, or
/// into `output` itself where that is one. A
/// network's file system gets some seconds to show it. Where rank 0 has
/// no such folder, nothing is said: whoever creates the output does. Collective. Throws Error{io}
/// and Error{invalid_argument}.
void require_same_folder(Communicator& ranks, const std::filesystem::path& output);

}  // namespace isonest::detail
