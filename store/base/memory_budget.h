// The rule of every memory budget: what a call needs at least, and what it says if it gets less.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail {

/// Heap that no budget divides: the program's own, HDF5's and TBB's. Measured by
/// tools/bench/peak_heap.cpp: 1.2 to 3.4 MB on a store of 9^3 nodes, by any command that draws no
/// picture; the rest is for what grows slowly (HDF5's caches, TBB's tasks, names of parts), and for
/// what is kept of a store that is far away (at most 5.6 MB: ChunkTable, CubeRangeTable).
inline constexpr std::uint64_t kLibraryHeap = std::uint64_t{10} << 20U;

/// Throws Error{limit} if `memory` is less than `least` (bytes). The error's place is `subject`; it
/// says for what the memory is too little, and its first remedy names a memory that is enough;
/// `also`: what else helps.
void require_memory(const std::string& subject, std::uint64_t memory, std::uint64_t least,
                    const std::string& for_what, std::vector<Remedy> also = {});

}  // namespace isonest::detail
