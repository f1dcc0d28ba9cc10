// Whether ranks have the same, before they work together.
#pragma once

#include <string>
#include <string_view>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// At rank 0 the ranks whose text is not `expected`, with their machines: "2 (node7), 5 (node9)",
/// the first eight of them; nothing if there are none, and at the others. `own`: this rank's, short
/// and without a line end; `expected`: rank 0's own counts, others may give anything. Collective.
std::string who_differs(Communicator& ranks, std::string_view own, std::string_view expected);

}  // namespace isonest::detail
