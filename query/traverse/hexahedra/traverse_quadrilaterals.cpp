#include "query/traverse/hexahedra/traverse_quadrilaterals.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "query/traverse/height_rounding.h"
#include "query/traverse/hexahedra/cell_scout.h"

namespace isonest::detail {
namespace {

/// Corners and midpoints of edges, counterclockwise from the low corner, in half edges.
constexpr std::array<Int3, 8> kAround{
    {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}, {0, 2, 0}, {0, 1, 0}}};

/// One thread's traversal.
class QuadWorker {
  public:
    QuadWorker(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
               const PartSink& sink, Progress& progress)
        : walk(cache.source().layout().lattice(), query.box),
          is_finest_(query.tolerance.is_zero()),
          projection_(cache, query.stop, query.tolerance.threshold()),
          attributes_(query.attributes, cache, query.attribute_values),
          mesh_(&attributes_),
          scale_(query.attributes.graph_scale.value_or(1)),
          parts_(query.box, part_vertices, sink, progress) {}
    QuadWorker(const QuadWorker&) = delete;
    QuadWorker& operator=(const QuadWorker&) = delete;

    void begin(std::uint64_t subtree) { parts_.begin(subtree); }
    void flush() { parts_.flush(mesh_); }
    /// See CellWalk.
    bool refines(const Cell& cell, Overlap where) {
        double number = 0;
        bool refined = cell.level > 0;
        if (refined && !is_finest_) {
            number = projection_.number(cell.level, cell.at);
            refined = !projection_.stops(number);
        }
        if (!refined) {
            add(cell, number, where == Overlap::crossing);
        }
        return refined;
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.visited = walk.visited();
        counts.value_rounding.add(attributes_.value_rounding());
        counts.error_bound = std::max(counts.error_bound, projection_.largest_number());
        return counts;
    }

    CellWalk<2> walk;

  private:
    [[nodiscard]] double value(const Int3& node) {
        return is_finest_ ? projection_.exact(node, 0) : projection_.value(node);
    }

    void add(const Cell& cell, double number, bool cut) {
        std::array<Corner, 8> around;
        std::size_t count = 0;
        for (std::size_t i = 0; i < 8; ++i) {
            const Int3& o = kAround[i];
            const bool corner = i % 2 == 0;
            if (!corner && (is_finest_ || cell.level == 0 ||
                            !projection_.is_refined(cell.level, cell.at + o - Int3{1, 1, 0}))) {
                continue;
            }
            const Int3 twice = (cell.at * 2 + o) * cell.edge();
            const Int3 node{twice.x / 2, twice.y / 2, 0};
            around[count++] = {node, value(node)};
            if (!std::isfinite(around[count - 1].value)) {
                return;
            }
        }
        ++counts_.leaves;
        counts_.error_bound = std::max(counts_.error_bound, number);
        if (count == 4) {
            const bool first = std::fabs(around[0].value - around[2].value) <=
                               std::fabs(around[1].value - around[3].value);
            const std::size_t a = first ? 0 : 1;
            add_triangle({around[a], around[a + 1], around[a + 2]}, cut);
            add_triangle({around[a], around[a + 2], around[(a + 3) % 4]}, cut);
        } else {
            const Corner centre = centre_of(cell);
            for (std::size_t i = 0; i < count; ++i) {
                add_triangle({centre, around[i], around[(i + 1) % count]}, cut);
            }
        }
        parts_.flush_if_full(mesh_);
    }
    /// Of the bilinear function.
    [[nodiscard]] Corner centre_of(const Cell& cell) {
        double sum = 0;
        for (std::size_t i = 0; i < 8; i += 2) {
            const Int3& o = kAround[i];
            sum += projection_.value((cell.at + Int3{o.x / 2, o.y / 2, 0}) * cell.edge());
        }
        return {projection_.lattice().centre_of(cell.level, cell.at), sum / 4};
    }
    void add_triangle(const std::array<Corner, 3>& corners, bool cut) {
        mesh_.add_graph(corners, cut);
        counts_.height_rounding =
            std::max(counts_.height_rounding, height_rounding(corners, scale_, cut));
    }

    bool is_finest_;  ///< nothing stops above the finest level, and no field is needed
    HexProjection projection_;
    AttributeSampler attributes_;
    LocalMesh mesh_;
    double scale_;
    SubtreeParts parts_;
    TraversalCounts counts_;
};

/// Levels below the coarsest at which the subtrees begin that are the threads' work.
constexpr int kTopQuadLevels = 5;

}  // namespace

TraversalCounts traverse_quadrilaterals(ChunkCache& cache, const TraversalQuery& query,
                                        std::size_t part_vertices, const PartSink& sink,
                                        Progress& progress) {
    return walk_cells<2>(cache, query, kTopQuadLevels, progress,
                         [&] { return QuadWorker(cache, query, part_vertices, sink, progress); });
}

}  // namespace isonest::detail
