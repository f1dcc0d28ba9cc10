// The distances of all elements that share a refinement node, saturated, for one isovalue.
//
// Saturation is the paper's (section 2): a node's number is at least that of the nodes that its
// elements' children are refined at. It is done bisection by bisection, from the finest on.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Nodes are named by half_lattice_key() of twice the node.
struct NodeError {
    std::uint64_t node = 0;
    float error = 0;
};
/// An element's refinement node and that of one of its children.
struct NodeLink {
    std::uint64_t parent = 0;
    std::uint64_t child = 0;
    int height = 0;  ///< of the child: bisections above the finest level
};

/// What grows with the surface lies in temporary files. Thread-safety: at() from any thread once
/// saturate() was called, the rest from one.
class NodeErrors {
  public:
    /// REQUIRES of all heights: less than this.
    static constexpr int kHeights = 16;

    explicit NodeErrors(ScratchFolder folder);
    /// Throws Error{io}.
    void append(std::span<const NodeError> errors, std::span<const NodeLink> links);
    /// After the last append(). Throws Error{io}.
    void saturate();
    /// 0 at nodes that none of the elements has that were appended.
    [[nodiscard]] double at(std::uint64_t node) const;

  private:
    struct Pair {
        std::uint64_t parent = 0;
        std::uint64_t child = 0;
    };
    [[nodiscard]] NodeError& place(std::uint64_t node) const;

    ScratchFolder folder_;
    GrowingFile<NodeError> errors_;
    std::vector<std::unique_ptr<GrowingFile<Pair>>> links_;  ///< by height
    ScratchFile table_;                                      ///< hashed; 0 is no node
    std::uint64_t mask_ = 0;
};

}  // namespace isonest::detail
