#include "query/values/topology.h"

#include <algorithm>

#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

std::uint8_t position_of(const Int3& p) {
    return static_cast<std::uint8_t>(p.x + 3 * p.y + 9 * p.z);
}

TopologyTetrahedron describe(const Tetrahedron& t) {
    TopologyTetrahedron out;
    for (std::size_t i = 0; i < 4; ++i) {
        out.vertices[i] = position_of(t.v[i]);
        out.nodes |= std::uint32_t{1} << out.vertices[i];
    }
    const Int3 a = t.v[1] - t.v[0];
    const Int3 b = t.v[2] - t.v[0];
    const Int3 c = t.v[3] - t.v[0];
    out.positive = a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
                       a.z * (b.x * c.y - b.y * c.x) >
                   0;
    return out;
}

/// Which Kuhn tetrahedron of its cube a kind-0 tetrahedron is, given the axes of its path.
std::uint8_t order_of(const Tetrahedron& t) {
    std::array<int, 3> axes{};
    for (std::size_t i = 0; i < 3; ++i) {
        const Int3 step = t.v[i + 1] - t.v[i];
        axes[i] = step.x != 0 ? 0 : step.y != 0 ? 1 : 2;
    }
    const auto* const found = std::find(kAxisOrders.begin(), kAxisOrders.end(), axes);
    return static_cast<std::uint8_t>(found - kAxisOrders.begin());
}

Topology make() {
    Topology out;
    std::uint8_t faces = 0;
    std::uint8_t edges = 0;
    for (std::size_t order = 0; order < 6; ++order) {
        const Tetrahedron t0 = kuhn_tetrahedron({0, 0, 0}, 2, static_cast<int>(order));
        out.cube[order] = describe(t0);
        out.cube[order].ref_node = position_of(t0.ref_node());
        const auto t1 = t0.bisect();
        for (std::size_t i = 0; i < 2; ++i) {
            out.cube[order].children[i] = faces;
            TopologyTetrahedron& face = out.face[faces++];
            face = describe(t1[i]);
            face.ref_node = position_of(t1[i].ref_node());
            const auto t2 = t1[i].bisect();
            for (std::size_t j = 0; j < 2; ++j) {
                face.children[j] = edges;
                TopologyTetrahedron& edge = out.edge[edges++];
                edge = describe(t2[j]);
                edge.ref_node = position_of(t2[j].ref_node());
                const auto t3 = t2[j].bisect();
                for (std::size_t k = 0; k < 2; ++k) {
                    // The subcube's all-even corner is v0, a corner of this cube.
                    const Int3 corner = t3[k].v[0];
                    edge.children[k] = static_cast<std::uint8_t>(corner.x / 2 + corner.y / 2 * 2 +
                                                                 corner.z / 2 * 4);
                    edge.child_orders[k] = order_of(t3[k]);
                    TopologyTetrahedron& subcube =
                        out.subcube[edge.children[k]][edge.child_orders[k]];
                    subcube = describe(t3[k]);
                    edge.nodes |= subcube.nodes;
                    out.corners[edge.children[k]] |= subcube.nodes;
                    const auto bit = static_cast<std::uint8_t>(1U << edge.child_orders[k]);
                    out.below_face[out.cube[order].children[i]][edge.children[k]] |= bit;
                    out.below_cube[order][edge.children[k]] |= bit;
                }
                face.nodes |= edge.nodes;
            }
            out.cube[order].nodes |= face.nodes;
        }
    }
    std::uint8_t number = 0;
    const auto count = [&](auto& list) {
        for (TopologyTetrahedron& t : list) {
            t.number = number++;
        }
    };
    count(out.cube);
    count(out.face);
    count(out.edge);
    std::for_each(out.subcube.begin(), out.subcube.end(), count);
    return out;
}

}  // namespace

const Topology& topology() {
    static const Topology tables = make();
    return tables;
}

}  // namespace isonest::detail
