// The children of nodes, compared with the elements that bisection makes around each node.
#include "store/lattice/children.h"

#include <array>
#include <catch2/catch.hpp>
#include <cstdint>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "query/traverse/adapt_traverse.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

struct Before {
    bool operator()(const Int3& a, const Int3& b) const {
        return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
    }
};
using Nodes = std::set<Int3, Before>;

/// Whether the element is in a cube of the level of its refinement node.
template <int D>
bool exists(const Lattice& lattice, const Element<D>& t) {
    const NodeInfo node = describe_node(t.ref_node(), lattice.top());
    const Int3 end = lattice.cells_at(node.level()) * (2 * node.scale);
    for (const Int3& v : t.v) {
        if (max(v, end) != end) {
            return false;
        }
    }
    return true;
}

template <int D>
void compare(const Int3& n) {
    CAPTURE(n.x, n.y, n.z);
    const Lattice lattice(n);
    std::map<Int3, Nodes, Before> expected;
    std::vector<Element<D>> left = coarsest_elements<D>(lattice);
    while (!left.empty()) {
        const Element<D> t = left.back();
        left.pop_back();
        if (t.level == 0) {
            continue;
        }
        if (exists(lattice, t)) {
            Nodes& children = expected[t.ref_node()];
            for (const Element<D>& half : t.bisect(0)) {
                if (half.level > 0 && exists(lattice, half)) {
                    children.insert(half.ref_node());
                }
            }
        }
        for (const Element<D>& half : t.bisect(0)) {
            left.push_back(half);
        }
    }
    std::size_t compared = 0;
    for (const auto& [p, children] : expected) {
        CAPTURE(p.x, p.y, p.z);
        Nodes found;
        std::size_t calls = 0;
        for_children(lattice, p, describe_node(p, lattice.top()), [&](const Int3& child) {
            found.insert(child);
            ++calls;
        });
        REQUIRE(found == children);
        REQUIRE(calls == found.size());
        compared += found.size();
    }
    CHECK(compared > 0);
}

}  // namespace

TEST_CASE("the children of a node are the refinement nodes of the halves of its elements") {
    for (const Int3& n : {Int3{9, 9, 9}, {6, 11, 4}, {2, 5, 13}}) {
        compare<3>(n);
    }
    for (const Int3& n : {Int3{17, 17, 1}, {6, 1, 11}, {1, 3, 12}}) {
        compare<2>(n);
    }
    for (const Int3& n : {Int3{17, 1, 1}, {1, 11, 1}, {1, 1, 6}}) {
        compare<1>(n);
    }
}
