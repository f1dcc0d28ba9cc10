// U, its projection P U on an adaptive mesh, and an indicator, at all nodes of a volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2: P U is U at the refined nodes, and the mean
// of the ends of the refinement edge at all others.
#pragma once

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/study.h>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/interest.h"
#include "store/container/chunk_cache.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// Numbers for all nodes of elements of the nested grid.

/// The nodes of elements, including those outside the volume. Level L's cubes tile the volume, so
/// their extent grows with L: there are few nodes beyond those of level 1's cubes, and only on
/// coarse levels.
class NodeIndex {
  public:
    explicit NodeIndex(const Lattice& lattice) {
        for (int level = std::min(1, lattice.top()); level <= lattice.top(); ++level) {
            const Int3 last = lattice.cells_at(level) * (std::int64_t{1} << level);
            if (regions_.empty() || last != regions_.back().last) {
                const std::int64_t scale = level > 0 ? std::int64_t{1} << (level - 1) : 1;
                const Int3 size =
                    Int3{last.x / scale, last.y / scale, last.z / scale} + Int3{1, 1, 1};
                regions_.push_back({last, size, scale, count_});
                count_ += static_cast<std::size_t>(size.product());
            }
        }
    }
    [[nodiscard]] std::size_t count() const { return count_; }
    /// REQUIRES: the node belongs to an element.
    [[nodiscard]] std::size_t of(const Int3& p) const {
        const Region* region = regions_.data();
        while (max(p, region->last) != region->last) {
            ++region;
        }
        return region->first +
               static_cast<std::size_t>(region->size.linear(
                   {p.x / region->scale, p.y / region->scale, p.z / region->scale}));
    }
    /// The size of the dense lattice of all nodes of level 1's cubes.
    [[nodiscard]] const Int3& dense() const { return regions_.front().size; }
    /// Calls f(p) for all other nodes.
    template <class F>
    void for_others(const F& f) const {
        for (std::size_t r = 1; r < regions_.size(); ++r) {
            const Int3& nearer = regions_[r - 1].last;
            for (std::int64_t i = 0; i < regions_[r].size.product(); ++i) {
                const Int3 p = regions_[r].size.unlinear(i) * regions_[r].scale;
                if (max(p, nearer) != nearer) {
                    f(p);
                }
            }
        }
    }

  private:
    /// Multiples of `scale` up to `last`.
    struct Region {
        Int3 last;
        Int3 size;
        std::int64_t scale;
        std::size_t first;
    };
    std::vector<Region> regions_;
    std::size_t count_ = 0;
};

class WholeLattice {
  public:
    /// `bound`: the field of the interest test of count_surface(), if that is called. REQUIRES:
    /// is_bound(bound); the store has it.
    explicit WholeLattice(const StoreLayout& layout, std::optional<Field> bound = {});

    /// Size in bytes.
    static std::uint64_t heap(const StoreLayout& layout, std::optional<Field> bound = {});

    /// Throws what ChunkCache throws.
    void load_values(ChunkCache& cache);
    /// Returns the largest finite value. Throws what ChunkCache throws, and Error{cancelled}.
    double load_indicator(ChunkCache& cache, Field field, Progress& progress);
    /// REQUIRES: a bound was given. Throws the same.
    void load_bound(ChunkCache& cache, Progress& progress);
    /// Computes P U of the mesh that refines the nodes whose indicator is at least `threshold`.
    /// Returns the number of its nodes in the volume.
    std::uint64_t project(double threshold);

    /// Counts the elements of that mesh, including those that extend beyond the volume, and the
    /// elements that AdaptTraverse tests to find them. With a plane, the mesh's elements are those
    /// that it cuts, and the interest test is whether it does. The same for any number of threads,
    /// which are the arena's. REQUIRES: a plane only in a volume.
    [[nodiscard]] VisitCounts count(double threshold, const LatticePlane* plane) const;
    /// Counts the elements of that mesh in which its linear function takes the isovalue, and the
    /// elements that AdaptTraverse tests to find them, by HoldsIsovalue. REQUIRES: the bound is
    /// loaded.
    [[nodiscard]] VisitCounts count_surface(double threshold, double iso) const;
    /// The same for cells; their indicators are those at their centres.
    [[nodiscard]] VisitCounts count_cells(double threshold) const;
    /// Norms at the nodes of the finest lattice (the trapezoidal rule), without missing data.
    [[nodiscard]] ErrorNorms measure(double range) const;

    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    [[nodiscard]] double exact(const Int3& p) const { return exact_[number_.of(p)]; }
    [[nodiscard]] float indicator(const Int3& p) const { return eta_[number_.of(p)]; }
    /// May be called for different nodes from different threads.
    void set_indicator(const Int3& p, float eta) { eta_[number_.of(p)] = eta; }
    [[nodiscard]] double projected(const Int3& p) const { return projected_[number_.of(p)]; }
    /// From coarse to fine: sets P U to U at the corners of the coarsest cube, and at all other
    /// nodes of elements to `interpolated(p, node)`, computed from P U at coarser nodes, or to U if
    /// that returns nothing. Returns the number of the volume's nodes where it is U.
    template <class Interpolated>
    std::uint64_t project_by(const Interpolated& interpolated);

  private:
    struct Numbers;
    [[nodiscard]] std::size_t at(const Int3& p) const { return number_.of(p); }
    template <int D, class Interest, class IsLeaf>
    [[nodiscard]] VisitCounts traverse(double threshold, const Interest& interest,
                                       const IsLeaf& is_leaf) const;
    template <class Interest, class IsLeaf>
    [[nodiscard]] VisitCounts traverse(double threshold, const Interest& interest,
                                       const IsLeaf& is_leaf) const;
    template <class Set>
    double load_numbers(ChunkCache& cache, Field field, Progress& progress, const Set& set_number);

    const StoreLayout& layout_;
    const Lattice& lattice_;
    NodeIndex number_;
    std::vector<double> exact_;
    std::vector<double> projected_;
    std::vector<float> eta_;
    std::vector<float> bound_;  ///< empty without one
    std::optional<Field> bound_field_;
};

template <class Interpolated>
std::uint64_t WholeLattice::project_by(const Interpolated& interpolated) {
    // The corners come first: nodes in other planes are projected from them.
    const Int3 far = lattice_.cells_at(lattice_.top()) * (std::int64_t{1} << lattice_.top());
    const Int3 last = lattice_.nodes() - Int3{1, 1, 1};
    std::uint64_t nodes = 0;
    for (std::int64_t i = 0; i < 8; ++i) {
        const Int3 o = Int3{2, 2, 2}.unlinear(i);
        // Along a flat axis there is one corner.
        const bool twice =
            (o.x > 0 && last.x == 0) || (o.y > 0 && last.y == 0) || (o.z > 0 && last.z == 0);
        const Int3 corner{o.x * far.x, o.y * far.y, o.z * far.z};
        projected_[at(corner)] = exact_[at(corner)];
        nodes += !twice && max(corner, last) == last ? 1 : 0;
    }
    for (int level = lattice_.top(); level >= 1; --level) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        const Int3 size = lattice_.cells_at(level) * 2 + Int3{1, 1, 1};
        std::vector<std::uint64_t> of_layer(static_cast<std::size_t>(size.z), 0);
        oneapi::tbb::parallel_for(std::int64_t{0}, size.z, [&](std::int64_t z) {
            std::uint64_t count = 0;
            for (std::int64_t i = 0; i < size.x * size.y; ++i) {
                const Int3 p = Int3{i % size.x, i / size.x, z} * scale;
                const NodeInfo node = describe_node(p, lattice_.top());
                if (node.scale == scale) {
                    const std::optional<double> value = interpolated(p, node);
                    projected_[at(p)] = value ? *value : exact_[at(p)];
                    count += value || max(p, last) != last ? 0 : 1;
                }
            }
            of_layer[static_cast<std::size_t>(z)] = count;
        });
        for (const std::uint64_t count : of_layer) {
            nodes += count;
        }
    }
    return nodes;
}

// The adaptive grid of hexahedra (quadrilaterals, edges) on a volume in memory, and P U on it.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2: P U is U at the nodes that do not
// hang, and d-linear between the corners of a cell that is not refined.

/// Sets the lattice's indicator at the centres of the cells of all levels from 1 on to the cells'
/// numbers. Returns the largest finite one. The same for any number of threads, which are the
/// arena's. REQUIRES: is_of_cells(field); the store has it. Throws what ChunkCache throws, and
/// Error{cancelled}.
double load_cell_numbers(WholeLattice& whole, ChunkCache& cache, Field field, Progress& progress);

/// Computes P U of the grid that refines the cells whose number is at least `threshold`, at all
/// nodes. Returns the number of the grid's nodes in the volume that do not hang. REQUIRES: the
/// numbers of cells are loaded.
std::uint64_t project_on_cells(WholeLattice& whole, double threshold);

}  // namespace isonest::detail
