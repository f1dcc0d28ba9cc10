// The indicators that are a multiple of |U_delta|: norms of the hat function at the node.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4: eta_p, eta_{1,p} and eta_{1,e}. The gradient
// of the hat function is constant on each child of an element. If the axes are at right angles, all
// elements around a node of one kind are mirror images of each other, so the factor depends only on
// the kind, the spacing and the number of cubes around the node; otherwise also on which cubes
// these are.
#pragma once

#include <array>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"
#include "store/base/vectors.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {

// The diamond of a refinement node: the elements that share its refinement edge.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2. Elements are tetrahedra, or triangles or
// edges if axes of the lattice are flat.

/// Whether `offset` is 0 along all flat axes (bits x, y, z).
bool in_flat_space(const Int3& offset, unsigned flat);

/// The vertices of t that have the same coordinates as `node` along all flat axes, in the order of
/// t.
std::vector<Int3> trace(const Tetrahedron& t, const Int3& node, unsigned flat);

/// The tetrahedra that refine at `node`, in the cubes with this edge around `cube`, and whose trace
/// is an element; cubes outside the flat space are left out. Several may have the same trace.
std::vector<Tetrahedron> tetrahedra_around(const Int3& cube, std::int64_t edge, const Int3& node,
                                           unsigned flat);

/// One element that refines at the node, in half edges of the node's level, relative to the node.
struct DiamondElement {
    std::array<Int3, 4> v;  ///< v[0] and v[1] are the ends of the refinement edge
    int vertices = 4;
    Int3 cube;  ///< the cube (square, edge) of the level that contains it, relative to the node's
                ///< owner
};

/// The elements around the node in `slot` of a lattice node with these parities (bits x, y, z).
/// `flat`: bits of the flat axes, which must be 0 in parities and slot. Derived from explicit
/// bisection on first use. Thread-safe.
const std::vector<DiamondElement>& diamond(int slot, unsigned parities, unsigned flat);

/// Factors for one level. Thread-safe.
class OffsetNorms {
  public:
    /// `steps`: of the finest lattice; `flat`: bits of the flat axes.
    OffsetNorms(const LatticeSteps& steps, int level, unsigned flat);

    /// indicator / |U_delta| at a node of `slot` with `cubes` cubes (squares, edges) of the level
    /// around it: 1 for a centre, up to 4. REQUIRES: is_offset_norm(indicator); axes at right
    /// angles.
    [[nodiscard]] double factor(Indicator indicator, int slot, int cubes) const;
    /// The same for any axes, for the node in `slot` of lattice node `owner`; `cells` are those of
    /// the level.
    [[nodiscard]] double factor(Indicator indicator, const Int3& owner, int slot,
                                const Int3& cells) const;

    /// Whether the indicator is a multiple of |U_delta|.
    static bool is_offset_norm(Indicator indicator);

    /// Multiplies slots first to last of layer k, never rounding below the exact product.
    template <class Real>
    void scale(Indicator indicator, const LayerRange& range, std::int64_t k, int first, int last,
               Layer<Real>& layer) const;

  private:
    struct Slot {
        double volume = 0;     ///< of the elements in one cube
        double grad_linf = 0;  ///< of the hat function of height 1
        double grad_l1 = 0;    ///< integral over one cube
        double grad_l2 = 0;    ///< integral of the square over one cube
        double edge_length = 1;
    };
    /// Cases of cubes along an axis: only the one after the node, only the one before, both.
    static constexpr int kSides = 3;
    void add(const DiamondElement& element, const LatticeSteps& steps, double half_edge,
             Slot& slot) const;
    [[nodiscard]] double factor(Indicator indicator, const Slot& slot, int cubes) const;

    unsigned flat_;
    int dimension_;
    std::array<Slot, kSlots> slots_;
    /// For sheared axes: over all cubes together, by parities of the owner, slot and sides along z,
    /// y, x.
    std::vector<Slot> sheared_;
};

}  // namespace isonest::detail
