// U, its projection P U on an adaptive mesh, and an indicator, in all nodes of a volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2: P U is U at the nodes that are refined, and
// the mean of the ends of the refinement edge at all others.
#pragma once

#include <oneapi/tbb/parallel_for.h>

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/progress.h>

#include "query/study/node_index.h"
#include "query/traverse/adapt_traverse.h"
#include "query/traverse/lattice_plane.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Norms of P U - U, relative to a range of values and to the size of what they are taken over.
struct ErrorNorms {
    double l1 = 0;
    double l2 = 0;
    double linf = 0;
};

class WholeLattice {
  public:
    explicit WholeLattice(const StoreLayout& layout);

    /// Bytes that it takes.
    static std::uint64_t heap(const StoreLayout& layout);

    /// Throws what ChunkCache throws.
    void load_values(ChunkCache& cache);
    /// Returns the largest finite value. Throws what ChunkCache throws, and Error{cancelled}.
    double load_indicator(ChunkCache& cache, Field field, Progress& progress);
    /// P U of the mesh that refines the nodes whose indicator is at least `threshold`. Returns the
    /// number of its nodes in the volume.
    std::uint64_t project(double threshold);

    /// The elements of that mesh, those too that reach out of the volume; with a plane those that
    /// it cuts. `threads`: 0 = as many as the machine has. REQUIRES: a plane in a volume alone.
    [[nodiscard]] VisitCounts count(double threshold, const LatticePlane* plane, int threads) const;
    /// By the nodes of the finest lattice (the trapezoidal rule), without missing data.
    [[nodiscard]] ErrorNorms measure(double range) const;

    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    [[nodiscard]] double exact(const Int3& p) const { return exact_[number_.of(p)]; }
    [[nodiscard]] float indicator(const Int3& p) const { return eta_[number_.of(p)]; }
    /// At different nodes from different threads.
    void set_indicator(const Int3& p, float eta) { eta_[number_.of(p)] = eta; }
    [[nodiscard]] double projected(const Int3& p) const { return projected_[number_.of(p)]; }
    /// From coarse to fine: sets P U to U in the corners of the coarsest cube, and at all other
    /// nodes that elements reach to what `interpolated(p, node)` makes of P U at coarser ones, or
    /// to U where that gives nothing. Returns at how many of the volume it is U.
    template <class Interpolated>
    std::uint64_t project_by(const Interpolated& interpolated);

  private:
    struct Numbers;
    [[nodiscard]] std::size_t at(const Int3& p) const { return number_.of(p); }
    template <int D>
    [[nodiscard]] VisitCounts count_elements(double threshold, int threads) const;

    const StoreLayout& layout_;
    const Lattice& lattice_;
    NodeIndex number_;
    std::vector<double> exact_;
    std::vector<double> projected_;
    std::vector<float> eta_;
};

template <class Interpolated>
std::uint64_t WholeLattice::project_by(const Interpolated& interpolated) {
    // The corners first, by themselves: nodes in other planes are projected from them.
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

}  // namespace isonest::detail
