// The nodal fields of a volume by explicit recursive bisection: slow, plain, and independent of the
// closed form of the lattice that the product uses.
//
// Source: T. Gerstner, M. Rumpf, U. Weikard, "Error Indicators for Multilevel Visualization and
// Computing on Nested Grids", Computers & Graphics 24 (2000), sections 2 and 3.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "store/int3.h"
#include "tests/oracle/simplex.h"

namespace isonest::oracle {

/// One number per node of the extended lattice, x fastest; 0 where no existing tetrahedron refines.
struct NodalField {
    Int3 size;
    std::vector<double> values;

    explicit NodalField(const Int3& n, double fill = 0)
        : size(n), values(static_cast<std::size_t>(n.product()), fill) {}
    [[nodiscard]] double at(const Int3& p) const {
        return values[static_cast<std::size_t>(size.linear(p))];
    }
    [[nodiscard]] double& at(const Int3& p) {
        return values[static_cast<std::size_t>(size.linear(p))];
    }
};

/// Which lattice nodes of a tetrahedron that reaches out of the volume its deviation looks at.
enum class DeviationPoints {
    volume,   ///< nodes of the volume: what a guarantee inside the volume needs, the smallest bound
    extended  ///< the nodes outside as well, where the value of the nearest node holds
};

/// A volume under the nested grid. Tetrahedra exist in the cubes whose low corner is below
/// nodes - 1 on every axis; those between two cube levels exist with the coarser cube. Values
/// outside are those of the nearest node; non-finite values are missing data. Thread-safety: const
/// members only read.
class BisectionOracle {
  public:
    /// `values`: nodes.product() numbers, x fastest. Macro cubes have the edge 2^macro_level; by
    /// default the smallest for which one cube covers the volume.
    /// REQUIRES: nodes >= 1, macro_level >= 0.
    BisectionOracle(const Int3& nodes, std::vector<double> values,
                    std::optional<int> macro_level = {});

    [[nodiscard]] const Int3& nodes() const { return nodes_; }
    [[nodiscard]] int macro_level() const { return macro_level_; }
    /// Nodes per axis of the lattice that the macro cubes span.
    [[nodiscard]] const Int3& extent() const { return extent_; }
    /// U(p); the nearest node's outside the volume.
    [[nodiscard]] double value(const Int3& p) const {
        return values_[static_cast<std::size_t>(
            nodes_.linear(max({0, 0, 0}, min(p, nodes_ - Int3{1, 1, 1}))))];
    }
    [[nodiscard]] bool has_missing_vertex(const Simplex& t) const;

    /// The existing tetrahedra of the macro cubes.
    [[nodiscard]] std::vector<Simplex> roots() const;
    /// The existing children (none, one or two). REQUIRES: !t.is_finest().
    [[nodiscard]] std::vector<Simplex> children(const Simplex& t) const;
    /// Number of generations; the last one holds the finest tetrahedra.
    [[nodiscard]] int generations() const { return 3 * macro_level_ + 1; }
    /// Calls `visit` with every existing tetrahedron after `generation` bisections.
    void for_each(int generation, const std::function<void(const Simplex&)>& visit) const;

    /// 1 at the nodes that some existing tetrahedron refines at, 0 elsewhere.
    [[nodiscard]] NodalField refinement_nodes() const;
    /// |U(x) - (U(x1) + U(x2)) / 2|; +inf if a vertex of a tetrahedron sharing x, or x, is missing.
    [[nodiscard]] NodalField eta() const;
    /// Largest |U - U_T| over the lattice nodes of all closed tetrahedra T sharing x, by
    /// enumeration; +inf if one of those nodes, or a vertex, is missing.
    [[nodiscard]] NodalField deviation(DeviationPoints points) const;
    /// bar(x) = max(field(x), max over children bar(c)).
    [[nodiscard]] NodalField saturated_by_maximum(const NodalField& field) const;
    /// plus(x) = field(x) + max over children plus(c).
    [[nodiscard]] NodalField saturated_by_sum(const NodalField& field) const;

    [[nodiscard]] NodalField linf_bar() const { return saturated_by_maximum(eta()); }
    [[nodiscard]] NodalField linf_plus() const { return saturated_by_sum(eta()); }
    [[nodiscard]] NodalField deviation_bar(DeviationPoints points) const {
        return saturated_by_maximum(deviation(points));
    }

    /// Largest |U - U_T| over the lattice nodes of the closed tetrahedron t; +inf as in
    /// deviation().
    [[nodiscard]] double deviation_of(const Simplex& t, DeviationPoints points) const;

  private:
    [[nodiscard]] bool exists(const Simplex& t) const;
    void descend(const Simplex& t, int generations,
                 const std::function<void(const Simplex&)>& visit) const;
    [[nodiscard]] NodalField saturated(const NodalField& field,
                                       double (*combine)(double own, double children)) const;

    Int3 nodes_;
    std::vector<double> values_;
    int macro_level_ = 0;
    Int3 extent_;
};

}  // namespace isonest::oracle
