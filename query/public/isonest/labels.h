// Labels: volumes whose values are not amounts but names of things (a segmentation).
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest {

/// A label, and where it is.
struct Label {
    std::int64_t id = 0;
    std::uint64_t nodes = 0;  ///< how many have it
    Int3 low{};               ///< smallest coordinates of its nodes
    Int3 high{};              ///< largest ones
};

struct LabelOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most
    int threads = 0;                                 ///< 0 = all cores
};

/// All labels of a store, by their ids. Each chunk of the finest values is read once.
/// Throws Error{unsupported} for values that are no whole numbers up to 2^53, Error{limit} for more
/// labels than the memory holds, Error{corrupt, io, cancelled}.
/// Thread-safety: any number of calls at once.
std::vector<Label> find_labels(const Store& store, const LabelOptions& options = {},
                               Progress& progress = silent_progress());

}  // namespace isonest
