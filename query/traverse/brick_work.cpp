#include "query/traverse/brick_work.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "query/march/clip.h"
#include "query/view/morton.h"

namespace isonest::detail {
namespace {

std::uint64_t order_of(int level, std::uint64_t morton) {
    return (static_cast<std::uint64_t>(63 - level) << 57U) | morton;
}

}  // namespace

template <class T>
void BrickWork<T>::march(const CubeNodes& nodes, const TopologyTetrahedron& t, double eta,
                         bool cut) {
    std::array<Corner, 4> corners;
    for (std::size_t i = 0; i < 4; ++i) {
        const int position = t.vertices[i];
        const auto at = static_cast<std::size_t>(position);
        const double value = (*nodes.target)[at];
        if (!std::isfinite(nodes.value[at]) || !std::isfinite(value)) {
            return;
        }
        corners[i] = {nodes.low + node_offset(position, nodes.mirror), value};
    }
    if (query_.culling && faces_away(nodes, t, 0)) {
        return;
    }
    ++counts_.leaves;
    counts_.error_bound = std::max(counts_.error_bound, eta);
    if (query_.on_leaf) {
        Leaf leaf{level_, corners};
        for (Corner& corner : leaf.corners) {
            corner.node = corner.node * stride_;
        }
        query_.on_leaf(leaf);
    }
    mesh_.march(corners, t.positive != is_mirror_image(nodes.mirror), iso_, cut);
}

/// What march() does with the tetrahedra of subcube `corner`, without asking for each node again.
/// REQUIRES: plain_.
template <class T>
void BrickWork<T>::march_subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask,
                                 bool cut) {
    counts_.visited += static_cast<std::uint64_t>(std::popcount(mask));
    Cube cube{nodes.subcube(corner), nodes.mirror ^ corner, 0, {}};
    for (unsigned i = 0; i < 8; ++i) {
        // Seen from the subcube's all-even corner, which is the parent's.
        const unsigned at = interest::kCorners[corner][i ^ corner];
        cube.value[i] = nodes.value[at];
        cube.below |= ((nodes.sides.below >> at) & 1U) << i;
    }
    if ((nodes.special & topology_.corners[corner]) == 0) {
        counts_.leaves += mesh_.march_cube(cube, iso_, cut);
        return;
    }
    for (std::size_t order = 0; order < 6; ++order) {
        const TopologyTetrahedron& t = topology_.subcube[corner][order];
        if ((nodes.special & t.nodes) == 0) {
            counts_.leaves += mesh_.march_in_cube(cube, order, iso_, cut);
        } else if ((mask >> order & 1U) != 0 && nodes.sides.both_in(t)) {
            march(nodes, t, 0, cut);
        }
    }
}

/// Finds out on which sides of the isovalue the finest function can be. Above level 0 that takes
/// the indicators of the subcubes, unless a plane is marched.
template <class T>
void BrickWork<T>::sharpen(CubeNodes& nodes) {
    if (level_ > 0 && !shared_.target.is_plane()) {
        std::array<double, 8> bound{};
        for (unsigned corner = 0; corner < 8; ++corner) {
            bound[corner] = beta(bound_.centre(nodes.subcube(corner)));
        }
        nodes.sides = sides_of(*nodes.target, bound, iso_);
    } else {
        nodes.sides = sides_of(*nodes.target, iso_);
    }
    if (plain_) {
        nodes.special = special_nodes(nodes.value, iso_);
    }
    nodes.sharp = true;
}

template <class T>
bool BrickWork<T>::in_question(const CubeNodes& nodes, const TopologyTetrahedron& t, double& raw) {
    ++counts_.visited;
    if (!nodes.sides.both_in(t) || culled(nodes, t)) {
        return false;
    }
    if (level_ == 0 || shared_.target.is_plane()) {
        return true;
    }
    raw = bound_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node);
    return may_cross(*nodes.target, t, raw * parents_bound_scale_, iso_);
}

template <class T>
bool BrickWork<T>::is_leaf(CubeNodes& nodes, const TopologyTetrahedron& t, double raw) {
    if (query_.tolerance.is_zero()) {
        return false;
    }
    const bool asked = level_ > 0 && !shared_.target.is_plane() && one_field_;
    const double eta = asked ? raw : stop_at(nodes, t.ref_node);
    if (!stops(nodes, t.ref_node, eta)) {
        return false;
    }
    march(nodes, t, eta, nodes.cut);
    return true;
}

template <class T>
void BrickWork<T>::edge(CubeNodes& nodes, int index) {
    const TopologyTetrahedron& t = topology_.edge[static_cast<std::size_t>(index)];
    double raw = 0;
    if (!in_question(nodes, t, raw) || is_leaf(nodes, t, raw)) {
        return;
    }
    if (!nodes.sharp) {
        sharpen(nodes);
        if (!nodes.sides.both_in(t)) {
            return;
        }
    }
    for (std::size_t i = 0; i < 2; ++i) {
        subcubes_[t.children[i]] |= static_cast<std::uint8_t>(1U << t.child_orders[i]);
    }
}

/// Where nothing stops below it, the subcubes that the finest function can cross say all that the
/// tetrahedra on the way would: two bisections at once.
template <class T>
void BrickWork<T>::face(CubeNodes& nodes, int index) {
    const TopologyTetrahedron& t = topology_.face[static_cast<std::size_t>(index)];
    double raw = 0;
    // Until the subcubes' centres are known: they may lie in chunks that nothing else needs.
    const bool asked = !nodes.sharp;
    if (asked && !in_question(nodes, t, raw)) {
        return;
    }
    if (edges_refine(nodes, t)) {
        skip_to_subcubes(nodes, topology_.below_face[static_cast<std::size_t>(index)]);
        return;
    }
    if ((asked || in_question(nodes, t, raw)) && !is_leaf(nodes, t, raw)) {
        edge(nodes, t.children[0]);
        edge(nodes, t.children[1]);
    }
}

/// Saturation: if neither edge's node stops, the face's does not either.
template <class T>
bool BrickWork<T>::edges_refine(CubeNodes& nodes, const TopologyTetrahedron& face) {
    return query_.tolerance.is_zero() ||
           std::none_of(face.children.begin(), face.children.end(), [&](std::uint8_t child) {
               const int position = topology_.edge[child].ref_node;
               const std::uint32_t bit = 1U << static_cast<unsigned>(position);
               if ((nodes.asked & bit) == 0) {
                   nodes.asked |= bit;
                   nodes.stopping |= stops(nodes, position, stop_at(nodes, position)) ? bit : 0;
               }
               return (nodes.stopping & bit) != 0;
           });
}

/// The tetrahedra in `mask` that may hold the surface.
template <class T>
std::uint8_t BrickWork<T>::those_in_question(const CubeNodes& nodes, std::uint8_t mask) {
    if (!nodes.sides.both_in(nodes_of(topology_.cube, mask))) {
        return 0;
    }
    std::uint8_t in = 0;
    for (unsigned order = 0; order < 6; ++order) {
        const TopologyTetrahedron& t = topology_.cube[order];
        double raw = 0;
        if ((mask >> order & 1U) != 0 &&
            (finest_ ? nodes.sides.both_in(t) : in_question(nodes, t, raw))) {
            in |= static_cast<std::uint8_t>(1U << order);
        }
    }
    return in;
}

/// Those in `mask` below which nothing stops before the subcubes.
template <class T>
std::uint8_t BrickWork<T>::refined_to_subcubes(CubeNodes& nodes, std::uint8_t mask) {
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

template <class T>
void BrickWork<T>::skip_to_subcubes(CubeNodes& nodes, const std::array<std::uint8_t, 8>& below) {
    if (!nodes.sharp) {
        sharpen(nodes);
    }
    for (std::size_t corner = 0; corner < 8; ++corner) {
        if (nodes.sides.both_in(topology_.corners[corner])) {
            subcubes_[corner] |= below[corner];
        }
    }
}

template <class T>
void BrickWork<T>::subcube(const CubeNodes& nodes, int corner, std::uint8_t mask) {
    const Int3 cube = nodes.subcube(static_cast<unsigned>(corner));
    bool cut = nodes.cut;
    if (cut) {
        const Overlap overlap =
            overlap_of(query_.box, cube * stride_, (cube + Int3{1, 1, 1}) * stride_);
        if (overlap == Overlap::outside) {
            return;
        }
        cut = overlap == Overlap::crossing;
    }
    if (ranged_) {
        const auto range = shared_.cache.source().cube_range(level_, cube);
        if (range && !range->may_hold(iso_)) {
            return;
        }
    }
    if (plain_) {
        return march_subcube(nodes, static_cast<unsigned>(corner), mask, cut);
    }
    double bound = 0;
    double eta = 0;
    bool leaf = level_ == 0;
    if (level_ > 0) {
        const bool exact = shared_.target.is_plane();
        bound = exact ? 0 : bound_.centre(cube);
        eta = one_field_ && !exact ? bound : stop_.centre(cube);
        leaf = !query_.tolerance.is_zero() &&
               query_.tolerance.stops(eta, (cube * 2 + Int3{1, 1, 1}) * stride_, stride_);
    }
    const auto& tetrahedra = topology_.subcube[static_cast<std::size_t>(corner)];
    const std::uint32_t vertices = nodes_of(tetrahedra, mask);
    if (level_ == 0 ? !nodes.sides.both_in(vertices)
                    : !may_cross_any(*nodes.target, vertices, beta(bound), iso_)) {
        return;
    }
    // Which of those that are refined are in question, the next finer values say better.
    std::uint8_t refined = 0;
    for (unsigned order = 0; order < 6; ++order) {
        if ((mask >> order & 1U) == 0) {
            continue;
        }
        const TopologyTetrahedron& t = tetrahedra[order];
        if (leaf) {
            march_stopped(nodes, t, beta(bound), eta, cut);
        } else if (query_.culling && faces_away(nodes, t, culling_.centre(cube))) {
            ++counts_.visited;
        } else {
            refined |= static_cast<std::uint8_t>(1U << order);
        }
    }
    if (refined != 0) {
        hand_down(cube, refined);
    }
}

/// A tetrahedron of a subcube whose centre stops.
template <class T>
void BrickWork<T>::march_stopped(const CubeNodes& nodes, const TopologyTetrahedron& t, double bound,
                                 double eta, bool cut) {
    ++counts_.visited;
    if (level_ == 0 ? nodes.sides.both_in(t) : may_cross(*nodes.target, t, bound, iso_)) {
        march(nodes, t, eta, cut);
    }
}

/// These tetrahedra of a subcube are to be refined.
template <class T>
void BrickWork<T>::hand_down(const Int3& cube, std::uint8_t mask) {
    const Int3 local = cube - base_;
    const Int3 octant = octant_of(local, half_);
    auto& list = children_[static_cast<std::size_t>(kOctants.linear(octant))];
    if (list == nullptr) {
        list = std::make_unique<MaskList>(static_cast<std::size_t>(half_ * half_ * half_));
    }
    (*list)[morton_code(local - octant * half_)] |= mask;
}

template <class T>
void BrickWork<T>::refine(const Int3& parent, std::uint8_t mask) {
    const Overlap overlap =
        overlap_of(query_.box, parent * (2 * stride_), (parent + Int3{1, 1, 1}) * (2 * stride_));
    if (overlap == Overlap::outside) {
        return;
    }
    CubeNodes nodes;
    load(nodes, parent);
    nodes.cut = overlap == Overlap::crossing;
    subcubes_.fill(0);
    // The finer values say more than the bound by which the level above asked for this cube. But
    // the subcubes' centres may lie in chunks that nothing else needs: where all stops above them.
    std::uint8_t refined = 0;
    if (level_ == 0 || shared_.target.is_plane()) {
        sharpen(nodes);
        mask = those_in_question(nodes, mask);
        refined = query_.tolerance.is_zero() ? mask : 0;
    } else {
        refined = refined_to_subcubes(nodes, mask);
        if (refined != 0) {
            sharpen(nodes);
        }
        // Where nothing stops before them, the subcubes as wholes say nearly as much.
        if (refined != mask) {
            mask = those_in_question(nodes, mask);
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
    for (int corner = 0; corner < 8; ++corner) {
        if (const std::uint8_t active = subcubes_[static_cast<std::size_t>(corner)]; active != 0) {
            subcube(nodes, corner, active);
        }
    }
}

template <class T>
void BrickWork<T>::flush() {
    if (!mesh_.empty()) {
        shared_.sink(order_, mesh_.finish(query_.box));
    }
}

/// `low`: where the next block of parents begins, in nodes of level_.
template <class T>
void BrickWork<T>::place(const Int3& low) {
    const StoreLayout& layout = shared_.cache.source().layout();
    const std::int64_t size = table_cells(layout);
    const Int3 cells = layout.lattice().cells_at(level_);
    // Parents reach one cell beyond an odd number of cells.
    const Int3 left = cells - low + Int3{1, 1, 1};
    mesh_.place(low, level_, max(min(left, {size, size, size}), {1, 1, 1}));
}

template <class T>
void BrickWork<T>::refine_parents(const MaskList& parents, std::size_t begin) {
    const Int3 first{base_.x / 2, base_.y / 2, base_.z / 2};
    const auto half_block =
        static_cast<std::size_t>(table_cells(shared_.cache.source().layout()) / 2);
    const std::size_t block_size = half_block * half_block * half_block;
    std::size_t block = std::numeric_limits<std::size_t>::max();
    for (std::size_t i = 0; i < parents.size(); ++i) {
        if (parents[i] == 0) {
            continue;
        }
        if (const std::size_t next = (begin + i) / block_size; next != block) {
            flush();
            block = next;
            place(first * 2 + morton_point(block * block_size) * 2);
        }
        const Int3 parent = first + morton_point(begin + i);
        if (mesh_.empty()) {
            order_ = order_of(level_, morton_code(parent));
        }
        refine(parent, parents[i]);
        if (mesh_.size() >= shared_.part_vertices) {
            flush();
        }
    }
    flush();
}

template <class T>
void BrickWork<T>::root() {
    const Int3 cells = shared_.cache.source().layout().lattice().cells_at(level_);
    if (cells.product() == 0) {
        return;  // a volume without thickness holds no tetrahedra
    }
    ++counts_.bricks;
    // The coarsest cube as subcube 0 of a parent that is never refined itself.
    CubeNodes nodes;
    load(nodes, {0, 0, 0});
    if (level_ == 0) {
        sharpen(nodes);
    }
    nodes.cut = true;
    place({0, 0, 0});
    order_ = order_of(level_, 0);
    subcube(nodes, 0, 0x3F);
    flush();
}

template class BrickWork<std::uint8_t>;
template class BrickWork<std::int8_t>;
template class BrickWork<std::uint16_t>;
template class BrickWork<std::int16_t>;
template class BrickWork<std::uint32_t>;
template class BrickWork<std::int32_t>;
template class BrickWork<float>;
template class BrickWork<double>;

}  // namespace isonest::detail
