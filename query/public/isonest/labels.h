// Labels: volumes whose values are identifiers rather than quantities (a segmentation).
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest {

/// A label and its extent.
struct Label {
    std::int64_t id = 0;
    std::uint64_t nodes = 0;  ///< number of nodes with this label
    Int3 low{};               ///< smallest coordinates of its nodes
    Int3 high{};              ///< largest coordinates of its nodes
};

struct LabelOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum bytes of heap
    int threads = 0;                                 ///< 0 = all cores
};

/// All labels of a store, sorted by id. Each chunk of the finest values is read once. Throws
/// Error{unsupported} if values are not integers up to 2^53, Error{limit} if there are more labels
/// than fit into memory, Error{corrupt, io, cancelled}. Thread-safety: any number of concurrent
/// calls.
std::vector<Label> find_labels(const Store& store, const LabelOptions& options = {},
                               Progress& progress = silent_progress());

}  // namespace isonest
