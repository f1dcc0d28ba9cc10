// On which side of the isovalue the nodes of a row are, a bit for each.
#pragma once

#include <cstddef>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Words of 64 bits that hold those of a row of so many nodes.
constexpr std::size_t words_of(std::int64_t nodes) {
    return static_cast<std::size_t>((nodes + 63) / 64);
}

/// Finds the sides for one isovalue.
template <class T>
class NodeBits {
  public:
    /// REQUIRES: crosses(iso).
    explicit NodeBits(double iso);
    /// Whether finite values can be on both sides.
    static bool crosses(double iso);

    /// Bit x of `below`: node x is below the isovalue; of `special`: it has the isovalue, or its
    /// value is missing. Both hold words_of(nodes) words; bits behind the row are 0. Whether any
    /// node is special.
    bool of_row(const T* row, std::int64_t nodes, std::uint64_t* below,
                std::uint64_t* special) const;

  private:
    T limit_;       ///< the smallest number that is not below
    T hit_;         ///< what equals the isovalue; of floats NaN if nothing does
    bool special_;  ///< there can be special nodes
};

/// The smallest and the largest finite one of `count` values are taken into low and high.
template <class T>
void widen_range(const T* values, std::int64_t count, double& low, double& high);

}  // namespace isonest::detail
