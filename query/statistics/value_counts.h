// How many nodes have a value, and through how many cubes an isosurface passes.
//
// Source: H. Carr, B. Duffy, B. Denby, "On Histograms and Isosurface Statistics", IEEE Transactions
// on Visualization and Computer Graphics 12 (2006): the cubes that a surface passes through measure
// its area better than the nodes near it.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/box.h"

namespace isonest::detail {

/// The bin of a node's value, plus 1; 0 if the value is missing.
using BinCode = std::uint16_t;
inline constexpr BinCode kMissingCode = 0;

/// Sums, which do not depend on the order in which they are made. Thread-safety: one thread.
class ValueCounts {
  public:
    explicit ValueCounts(int bins)
        : nodes_(static_cast<std::size_t>(bins) + 1),
          changes_(static_cast<std::size_t>(bins) + 1) {}

    /// Counts the first `own` nodes per axis of the box.
    void add_nodes(const Box<BinCode>& box, const Int3& own);
    /// Counts for each of the first `cells` cubes per axis through which isovalues the surface can
    /// pass: those above the bin of its smallest value, up to that of its largest. Missing values
    /// are left out. An axis along which the box has one node has cubes without extent.
    /// REQUIRES: cells < nodes of the box along the other axes.
    void add_cubes(const Box<BinCode>& box, const Int3& cells);
    /// Counts a cube with values in bins `low` to `high`; none if low > high.
    void add_cube(int low, int high) {
        if (low < high) {
            ++changes_[static_cast<std::size_t>(low) + 1];
            --changes_[static_cast<std::size_t>(high) + 1];
        }
    }
    void add(const ValueCounts& other);

    /// Of each bin.
    [[nodiscard]] std::vector<std::uint64_t> nodes() const {
        return {nodes_.begin() + 1, nodes_.end()};
    }
    [[nodiscard]] std::uint64_t missing() const { return nodes_.front(); }
    /// Of each bin, the cubes that the surface at the bin's smallest value passes through.
    [[nodiscard]] std::vector<std::uint64_t> cubes() const;

  private:
    std::vector<std::uint64_t> nodes_;  ///< by code
    /// By bin: cubes that begin less those that end there, modulo 2^64; one more, where the last
    /// bin's end.
    std::vector<std::uint64_t> changes_;
};

}  // namespace isonest::detail
