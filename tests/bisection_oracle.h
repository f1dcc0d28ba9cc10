// Indicators by explicit recursive bisection, without the closed form of the lattice.
//
// Source: Maubach's tagged bisection (1995): a tetrahedron (v0, v1, v2, v3; d) is cut at the
// midpoint z of v0 vd into (v0 .. v(d-1), z, v(d+1) ..; d') and (v1 .. vd, z, v(d+1) ..; d'), d' =
// d - 1, or 3 if d = 1.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <tuple>
#include <vector>

#include "store/lattice.h"

namespace isonest::test {

struct OracleNode {
    double eta = 0;
    double bar = 0;
    double plus = 0;
    double deviation = 0;  ///< not saturated
    double deviation_bar = 0;
};

class BisectionOracle {
  public:
    using Key = std::array<std::int64_t, 3>;
    /// `value` gives U, clamped outside. A non-finite value is missing.
    BisectionOracle(const Int3& n, const std::function<double(const Int3&)>& value);
    [[nodiscard]] const std::map<Key, OracleNode>& nodes() const { return nodes_; }

  private:
    struct Element {
        std::array<Int3, 4> v;
        int tag;
    };
    static Int3 middle(const Element& t) {
        const Int3 sum = t.v[0] + t.v[static_cast<std::size_t>(t.tag)];
        return {sum.x / 2, sum.y / 2, sum.z / 2};
    }
    static std::array<Element, 2> bisect(const Element& t);
    [[nodiscard]] bool exists(const Element& t) const;
    void visit(const Element& t, bool finest_next);
    double deviation(const Element& t) const;

    Int3 n_;
    std::function<double(const Int3&)> value_;
    std::map<Key, OracleNode> nodes_;
};

}  // namespace isonest::test
