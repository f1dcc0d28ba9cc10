// Checks that ranks see the same before they work together.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "store/ranks/communicator.h"

namespace isonest::detail {

// Checks that all ranks see the folder into which they write together.

/// Throws on rank 0 if a rank does not see what rank 0 has written into the folder of `output`, or
/// into `output` itself if that is a folder. A network file system gets some seconds to show it. If
/// the folder does not exist on rank 0, nothing is checked: creating the output reports that.
/// Collective. Throws Error{io} and Error{invalid_argument}.
void require_same_folder(Communicator& ranks, const std::filesystem::path& output);

// Checks that ranks have the same values before they work together.

/// Returns, on rank 0, the ranks whose text is not `expected`, with their machines: "2 (node7), 5
/// (node9)", at most the first eight; empty if there are none, and on the other ranks. `own`: the
/// text of this rank, short and without line ends; `expected`: used from rank 0 only, others may
/// pass anything. Collective.
std::string who_differs(Communicator& ranks, std::string_view own, std::string_view expected);

}  // namespace isonest::detail
