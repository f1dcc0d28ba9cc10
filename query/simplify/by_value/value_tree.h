// The tetrahedra of the nested grid that questions about values have met, kept as a tree.
//
// Source of the grid: section 2 of Gerstner, Rumpf, Weikard (2000); query/traverse/element.h. A
// tetrahedron is made when somebody asks for the halves of its parent, so that each number of the
// volume is looked up once, however many questions come.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/int3.h>

#include "query/traverse/element.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Numbers of nodes of a volume's nested grid, by coordinates of the finest lattice. May cache: one
/// per thread.
class GridNumbers {
  public:
    GridNumbers() = default;
    GridNumbers(const GridNumbers&) = delete;
    GridNumbers& operator=(const GridNumbers&) = delete;
    virtual ~GridNumbers() = default;
    /// U at a node of the lattice of `level` or a coarser one; NaN or infinite: missing.
    virtual double value(const Int3& node, int level) = 0;
    /// Of a refinement node: no point of a tetrahedron that is bisected there differs by more from
    /// the finest function. Infinite: unknown.
    virtual double deviation(const Int3& node) = 0;
    /// Nothing is asked for a while: what was cached for later goes.
    virtual void rest() = 0;
};

struct ValueTetrahedron {
    std::array<double, 4> value{};  ///< U less the isovalue, in the order of Element::v
    double deviation = 0;           ///< of the finest function from the linear one; 0 if finest
    /// |U - iso| is no larger anywhere in it. Infinite, or NaN: unknown.
    double most = 0;
    std::uint32_t first_child = 0;  ///< the other one follows; 0: not made
    std::int8_t kind = 0;           ///< as of Element
    std::int8_t level = 0;
    std::array<std::array<std::int32_t, 3>, 4> node{};
};

/// Not thread-safe.
class ValueTree {
  public:
    /// Tetrahedra at a time.
    static constexpr std::uint32_t kMost = 1U << 17U;
    static constexpr std::uint64_t kBytes = std::uint64_t{kMost} * sizeof(ValueTetrahedron);

    /// `numbers` have to stay. REQUIRES: lattice.dimension() == 3.
    ValueTree(GridNumbers& numbers, const Lattice& lattice, double iso);

    /// The six coarsest ones are 0 ... 5, in the order of kAxisOrders.
    static constexpr std::uint32_t kRoots = 6;
    [[nodiscard]] const ValueTetrahedron& at(std::uint32_t i) const { return all_[i]; }
    /// The first of the halves of one above the finest level, in the order of Element::bisect().
    /// References to others may be gone then. Nothing: there is no room left; clear() makes some.
    std::optional<std::uint32_t> children_of(std::uint32_t i);
    /// All but the roots go.
    void clear();

  private:
    [[nodiscard]] ValueTetrahedron described(const Element<3>& element);

    GridNumbers& numbers_;
    double iso_;
    std::vector<ValueTetrahedron> all_;
};

}  // namespace isonest::detail
