// Full resolution from a store behind a network: bricks of level 0 in windows, each of which is
// announced while the one before is worked on.
#pragma once

#include "query/traverse/brick_tree.h"

namespace isonest::detail {

/// Without a tolerance: all bricks of level 0, the last in Morton order first. What a brick needs
/// is found in up to three steps, each for a whole window: with a viewer the cubes of level 3 say
/// whether some of it faces the viewer; the chunk table names the chunks with values on both sides
/// of the isovalue; their values say into which others the surface reaches. A window's chunks take
/// an eighth of the cache, decoded, and three windows are under way; a window is one brick at
/// least. Throws what the chunk source and the sinks throw, and Error{cancelled}.
void run_finest_windows(Runs runs, std::uint64_t progress_share);

}  // namespace isonest::detail
