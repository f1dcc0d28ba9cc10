#include "query/traverse/hexahedra/traverse_hexahedra.h"

#include <algorithm>
#include <cmath>

#include "query/march/hex_cell.h"
#include "query/traverse/hexahedra/cell_scout.h"

namespace isonest::detail {
namespace {

/// One thread's traversal.
class HexWorker {
  public:
    HexWorker(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
              const PartSink& sink, Progress& progress)
        : walk(cache.source().layout().lattice(), query.box, query.share),
          query_(query),
          projection_(cache, query.stop, query.tolerance.threshold()),
          attributes_(query.attributes, cache, query.attribute_values),
          mesh_(&attributes_, query.plane.has_value()),
          parts_(query.box, part_vertices, sink, progress) {
        if (query.attribute_values == nullptr) {
            // NOLINTNEXTLINE(clang-analyzer-core.CallAndMessage): it takes this object for null
            attributes_.take_values([this](const Int3& node) { return projection_.value(node); });
        }
    }
    HexWorker(const HexWorker&) = delete;
    HexWorker& operator=(const HexWorker&) = delete;

    void begin(std::uint64_t subtree) { parts_.begin(subtree); }
    void flush() { parts_.flush(mesh_); }
    /// See CellWalk.
    bool refines(const Cell& cell, Overlap where) {
        const double number = cell.level > 0 ? projection_.number(cell.level, cell.at) : 0;
        if (!is_of_interest(query_, projection_, cell, number)) {
            return false;
        }
        if (cell.level > 0 && !projection_.stops(number)) {
            return true;
        }
        march(cell, number, where == Overlap::crossing);
        return false;
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.visited = walk.visited();
        counts.value_rounding.add(attributes_.value_rounding());
        return counts;
    }

    CellWalk<3> walk;

  private:
    void march(const Cell& cell, double number, bool cut) {
        if (walk.is_for_others()) {
            return;
        }
        projection_.forget_largest_number();
        HexCell hex{cell.low(), cell.edge(), projection_.nodes_of(cell.level, cell.at), {}};
        for (unsigned p = 0; p < 27; ++p) {
            if ((hex.nodes >> p & 1U) == 0) {
                continue;
            }
            const Int3 twice = Int3{3, 3, 3}.unlinear(p) * cell.edge();
            const Int3 node = cell.low() + Int3{twice.x / 2, twice.y / 2, twice.z / 2};
            const double value = projection_.value(node);
            if (!std::isfinite(value)) {
                return;
            }
            hex.value[p] = query_.plane ? query_.plane->distance(node) : value;
        }
        if (mesh_.march_hex_cell(hex, query_.plane ? 0 : query_.iso, cut)) {
            ++counts_.leaves;
            counts_.error_bound =
                std::max({counts_.error_bound, number, projection_.largest_number()});
        }
        parts_.flush_if_full(mesh_);
    }

    const TraversalQuery& query_;
    HexProjection projection_;
    AttributeSampler attributes_;
    LocalMesh mesh_;
    SubtreeParts parts_;
    TraversalCounts counts_;
};

/// Levels below the coarsest at which the subtrees begin that are the threads' work.
constexpr int kTopLevels = 3;

}  // namespace

TraversalCounts traverse_hexahedra(ChunkCache& cache, const TraversalQuery& query,
                                   std::size_t part_vertices, const PartSink& sink,
                                   Progress& progress) {
    return walk_cells<3>(cache, query, kTopLevels, progress,
                         [&] { return HexWorker(cache, query, part_vertices, sink, progress); });
}

}  // namespace isonest::detail
