#include "query/traverse/bricks/brick_traversal.h"

#include <algorithm>

#include "query/values/blocks.h"

namespace isonest::detail {

template <class Interest>
BrickTraversal<Interest>::BrickTraversal(TraversalRun& run, int level, const Int3& brick)
    : run_(run),
      query_(run.query),
      at_(run.layout(), level, brick),
      values_(run.cache, level, at_.base),
      interest_(run, at_),
      stop_(run, at_),
      culling_(run, at_),
      parts_(run, level, at_.base),
      action_(run, parts_.mesh(), level, interest_.iso()),
      counts_(run.counts.local()) {}

/// The interest test of a tetrahedron of any kind in a parent cube.
template <class Interest>
auto BrickTraversal<Interest>::question(const CubeNodes& nodes, const TopologyTetrahedron& t) const
    -> Question {
    if (!sides_of(nodes, nodes.cut).both_in(t) || culling_.all_below(nodes, t)) {
        return {};
    }
    if (Interest::kExact || at_.level == 0) {
        return {true, std::nullopt};
    }
    const double number = interest_.number(nodes, t);
    return {interest_.may_hold(nodes, t, number), number};
}

/// The stop test: eta if the tetrahedron is a leaf, otherwise nothing.
template <class Interest>
std::optional<double> BrickTraversal<Interest>::stopped(const CubeNodes& nodes,
                                                        const TopologyTetrahedron& t,
                                                        std::optional<double> number) const {
    if (stop_.never()) {
        return std::nullopt;
    }
    const double eta = number && stop_.is_bound() ? *number : stop_.number(nodes, t.ref_node);
    return stop_.stops(nodes, t.ref_node, eta) ? std::optional(eta) : std::nullopt;
}

/// Saturation: if neither edge's node stops, the face's node does not stop either. The results for
/// the nodes are stored with them.
template <class Interest>
bool BrickTraversal<Interest>::edges_refine(CubeNodes& nodes,
                                            const TopologyTetrahedron& face) const {
    return stop_.never() ||
           std::none_of(face.children.begin(), face.children.end(), [&](std::uint8_t child) {
               const int position = topology_.edge[child].ref_node;
               const std::uint32_t bit = 1U << static_cast<unsigned>(position);
               if ((nodes.asked & bit) == 0) {
                   nodes.asked |= bit;
                   nodes.stopping |=
                       stop_.stops(nodes, position, stop_.number(nodes, position)) ? bit : 0;
               }
               return (nodes.stopping & bit) != 0;
           });
}

/// The tetrahedra in `mask` below which nothing stops before the subcubes.
template <class Interest>
std::uint8_t BrickTraversal<Interest>::refined_to_subcubes(CubeNodes& nodes,
                                                           std::uint8_t mask) const {
    std::uint8_t refined = 0;
    for (unsigned order = 0; order < 6; ++order) {
        const auto& faces = topology_.cube[order].children;
        if ((mask >> order & 1U) != 0 && edges_refine(nodes, topology_.face[faces[0]]) &&
            edges_refine(nodes, topology_.face[faces[1]])) {
            refined |= static_cast<std::uint8_t>(1U << order);
        }
    }
    return refined;
}

/// Determines on which sides of the isovalue the finest function can be.
template <class Interest>
void BrickTraversal<Interest>::sharpen(CubeNodes& nodes) const {
    nodes.sides = interest_.sides(nodes);
    nodes.sharp = true;
}

template <class Interest>
Overlap BrickTraversal<Interest>::overlap_of_leaf(const std::array<Corner, 4>& corners) const {
    Int3 low = corners[0].node;
    Int3 high = low;
    for (const Corner& corner : corners) {
        low = min(low, corner.node);
        high = max(high, corner.node);
    }
    return overlap_of(query_.box, low * at_.stride, high * at_.stride);
}

template <class Interest>
void BrickTraversal<Interest>::march(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                     double eta, bool cut) {
    if (is_for_others_) {
        return;
    }
    const auto corners = complete_corners(nodes, interest_.function(nodes), t);
    if (!corners) {
        return;
    }
    if (cut) {
        // A cube may extend across the box although some of its tetrahedra do not.
        const Overlap overlap = overlap_of_leaf(*corners);
        if (overlap == Overlap::outside) {
            return;
        }
        cut = overlap == Overlap::crossing;
    }
    if (!culling_.leaf(nodes, t)) {
        action_(*corners, t.positive != is_mirror_image(nodes.mirror), eta, cut);
    }
}

template <class Interest>
void BrickTraversal<Interest>::edge(CubeNodes& nodes, std::size_t index) {
    const TopologyTetrahedron& t = topology_.edge[index];
    ++counts_.visited;
    const Question asked = question(nodes, t);
    if (!asked.may_hold) {
        return;
    }
    if (const auto eta = stopped(nodes, t, asked.number)) {
        return march(nodes, t, *eta, nodes.cut);
    }
    if (!nodes.sharp) {
        sharpen(nodes);
        if (!sides_of(nodes, nodes.cut).both_in(t)) {
            return;
        }
    }
    for (std::size_t i = 0; i < 2; ++i) {
        subcubes_[t.children[i]] |= static_cast<std::uint8_t>(1U << t.child_orders[i]);
    }
}

/// If nothing stops below, the subcubes that the finest function can cross give the same answer as
/// the tetrahedra in between: two bisections at once.
template <class Interest>
void BrickTraversal<Interest>::face(CubeNodes& nodes, std::size_t index) {
    const TopologyTetrahedron& t = topology_.face[index];
    // Until the subcubes' centres are known: they may be in chunks that are not needed otherwise.
    const bool first = !nodes.sharp;
    Question asked;
    if (first) {
        ++counts_.visited;
        asked = question(nodes, t);
        if (!asked.may_hold) {
            return;
        }
    }
    if (edges_refine(nodes, t)) {
        return skip_to_subcubes(nodes, topology_.below_face[index]);
    }
    if (!first) {
        ++counts_.visited;
        asked = question(nodes, t);
        if (!asked.may_hold) {
            return;
        }
    }
    if (const auto eta = stopped(nodes, t, asked.number)) {
        return march(nodes, t, *eta, nodes.cut);
    }
    edge(nodes, t.children[0]);
    edge(nodes, t.children[1]);
}

/// The tetrahedra in `mask` that may contain the surface.
template <class Interest>
std::uint8_t BrickTraversal<Interest>::visit_cube(const CubeNodes& nodes, std::uint8_t mask) {
    if (!sides_of(nodes, nodes.cut).both_in(nodes_of(topology_.cube, mask))) {
        return 0;
    }
    std::uint8_t in = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) != 0) {
            ++counts_.visited;
            in |= static_cast<std::uint8_t>(
                (question(nodes, topology_.cube[order]).may_hold ? 1U : 0U) << order);
        }
    }
    return in;
}

template <class Interest>
void BrickTraversal<Interest>::skip_to_subcubes(CubeNodes& nodes,
                                                const std::array<std::uint8_t, 8>& below) {
    if (!nodes.sharp) {
        sharpen(nodes);
    }
    const Sides sides = sides_of(nodes, nodes.cut);
    for (std::size_t corner = 0; corner < 8; ++corner) {
        if (sides.both_in(topology_.corners[corner])) {
            subcubes_[corner] |= below[corner];
        }
    }
}

template <class Interest>
void BrickTraversal<Interest>::subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask) {
    const Int3 cube = nodes.subcube(corner);
    bool cut = nodes.cut;
    if (cut) {
        const Overlap overlap =
            overlap_of(query_.box, cube * at_.stride, (cube + Int3{1, 1, 1}) * at_.stride);
        if (overlap == Overlap::outside) {
            return;
        }
        cut = overlap == Overlap::crossing;
    }
    if (interest_.excludes(cube, cut)) {
        return;
    }
    const bool finest = at_.level == 0;
    const double number = finest ? 0 : interest_.centre(cube);
    double eta = 0;
    bool leaf = finest;
    if (!finest) {
        if (!stop_.never()) {
            eta = stop_.is_bound() && !Interest::kExact ? number : stop_.centre(cube);
            leaf = stop_.stops_centre(cube, eta);
        }
    }
    const auto& tetrahedra = topology_.subcube[corner];
    const std::uint32_t vertices = nodes_of(tetrahedra, mask);
    const Sides sides = sides_of(nodes, cut);
    if (finest ? !sides.both_in(vertices) : !interest_.one_may_hold(nodes, vertices, number, cut)) {
        return;
    }
    // The next finer values decide better which of the refined tetrahedra are relevant.
    std::uint8_t refined = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) == 0) {
            continue;
        }
        const TopologyTetrahedron& t = tetrahedra[order];
        if (leaf) {
            ++counts_.visited;
            if (finest ? sides.both_in(t) : interest_.may_hold_below(nodes, t, number, cut)) {
                march(nodes, t, eta, cut);
            }
        } else if (culling_.all_below(nodes, t, cube)) {
            ++counts_.visited;
        } else {
            refined |= static_cast<std::uint8_t>(1U << order);
        }
    }
    if (refined != 0) {
        hand_down(cube, refined);
    }
}

/// Records that these tetrahedra of a subcube are to be refined.
template <class Interest>
void BrickTraversal<Interest>::hand_down(const Int3& cube, std::uint8_t mask) {
    const Int3 local = cube - at_.base;
    const Int3 octant = octant_of(local, at_.half);
    auto& list = children_[static_cast<std::size_t>(kOctants.linear(octant))];
    if (list == nullptr) {
        list = std::make_unique<MaskList>(static_cast<std::size_t>(at_.half * at_.half * at_.half));
    }
    (*list)[morton_code(local - octant * at_.half)] |= mask;
}

template <class Interest>
void BrickTraversal<Interest>::refine(const Int3& parent, std::uint8_t mask) {
    const std::int64_t edge = 2 * at_.stride;
    const Overlap overlap = overlap_of(query_.box, parent * edge, (parent + Int3{1, 1, 1}) * edge);
    if (overlap == Overlap::outside) {
        return;
    }
    CubeNodes nodes;
    values_.load(nodes, parent);
    interest_.prepare(nodes);
    nodes.cut = overlap == Overlap::crossing;
    subcubes_.fill(0);
    // The finer values are more precise than the bound by which the level above selected this cube.
    // But the subcubes' centres may be in chunks that are not needed otherwise, if everything stops
    // above them.
    std::uint8_t refined = 0;
    if (Interest::kExact || at_.level == 0) {
        sharpen(nodes);
        mask = visit_cube(nodes, mask);
        refined = stop_.never() ? mask : 0;
    } else {
        refined = refined_to_subcubes(nodes, mask);
        if (refined != 0) {
            sharpen(nodes);
        }
        // If nothing stops before the subcubes, testing whole subcubes is nearly as good.
        if (refined != mask) {
            mask = visit_cube(nodes, mask);
        }
    }
    for (std::size_t order = 0; order < 6; ++order) {
        const TopologyTetrahedron& t = topology_.cube[order];
        if ((mask & refined & (1U << order)) != 0) {
            skip_to_subcubes(nodes, topology_.below_cube[order]);
        } else if ((mask & (1U << order)) != 0) {
            face(nodes, t.children[0]);
            face(nodes, t.children[1]);
        }
    }
    for (unsigned corner = 0; corner < 8; ++corner) {
        if (const std::uint8_t active = subcubes_[corner]; active != 0) {
            subcube(nodes, corner, active);
        }
    }
}

template <class Interest>
void BrickTraversal<Interest>::refine_parents(const MaskList& parents, std::size_t begin) {
    const CubeShare& share = query_.share;
    parts_.for_each_parent(parents, begin, [&](const Int3& parent, std::uint8_t mask) {
        if (share.is_whole() || share.owns(at_.level + 1, parent)) {
            refine(parent, mask);
        } else {
            for_others([&] { refine(parent, mask); });
        }
    });
}

/// Processes a cube of another rank: nothing is marched or counted.
template <class Interest>
template <class Work>
void BrickTraversal<Interest>::for_others(const Work& work) {
    const TraversalCounts before = counts_;
    is_for_others_ = true;
    work();
    is_for_others_ = false;
    counts_ = before;
}

template <class Interest>
void BrickTraversal<Interest>::root() {
    const Int3 cells = run_.layout().lattice().cells_at(at_.level);
    if (cells.product() == 0) {
        return;  // a volume without thickness contains no tetrahedra
    }
    // The coarsest cube is treated as subcube 0 of a parent that is never refined itself.
    CubeNodes nodes;
    values_.load(nodes, {0, 0, 0});
    interest_.prepare(nodes);
    if (at_.level == 0) {
        sharpen(nodes);
    }
    nodes.cut = true;
    parts_.for_root([&] {
        if (query_.share.owns(at_.level, {0, 0, 0})) {
            ++counts_.bricks;
            subcube(nodes, 0, 0x3F);
        } else {
            for_others([&] { subcube(nodes, 0, 0x3F); });
        }
    });
}

template class BrickTraversal<IsovalueByBound>;
template class BrickTraversal<PlaneByDistance>;

}  // namespace isonest::detail
