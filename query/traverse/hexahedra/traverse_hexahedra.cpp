#include "query/traverse/hexahedra/traverse_hexahedra.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "query/march/hex_cell.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/traverse/interest.h"

namespace isonest::detail {
namespace {

struct Cell {
    int level;
    Int3 at;

    [[nodiscard]] std::int64_t edge() const { return std::int64_t{1} << level; }
    [[nodiscard]] Int3 low() const { return at * edge(); }
};

/// One thread's traversal.
class HexWorker {
  public:
    HexWorker(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
              const PartSink& sink, Progress& progress)
        : query_(query),
          projection_(cache, query.stop, query.tolerance.threshold()),
          attributes_(query.attributes, cache, query.attribute_values),
          mesh_(&attributes_, query.plane.has_value()),
          part_vertices_(part_vertices),
          sink_(sink),
          progress_(progress) {
        if (query.attribute_values == nullptr) {
            attributes_.take_values([this](const Int3& node) { return projection_.value(node); });
        }
    }
    HexWorker(const HexWorker&) = delete;
    HexWorker& operator=(const HexWorker&) = delete;

    /// The numbers of the parts that follow begin with that of their subtree.
    void begin(std::uint64_t subtree) {
        constexpr unsigned kPartBits = 40;
        parts_ = subtree << kPartBits;
    }
    void flush() {
        progress_.check();
        if (!mesh_.empty()) {
            sink_(parts_++, mesh_.finish(query_.box));
        }
    }
    /// AdaptTraverse down to `level_left`: cells of it are left, unvisited, to others.
    void visit(const Cell& cell, int level_left, std::vector<Cell>* left) {
        if (left != nullptr && cell.level == level_left) {
            left->push_back(cell);
            return;
        }
        const Overlap where =
            overlap_of(query_.box, cell.low(), cell.low() + Int3{1, 1, 1} * cell.edge());
        if (where == Overlap::outside) {
            return;
        }
        ++counts_.visited;
        const double number = cell.level > 0 ? projection_.number(cell.level, cell.at) : 0;
        if (!is_of_interest(cell, number)) {
            return;
        }
        if (cell.level == 0 || projection_.stops(number)) {
            march(cell, number, where == Overlap::crossing);
            return;
        }
        for (unsigned child = 0; child < 8; ++child) {
            const Cell part{cell.level - 1, cell.at * 2 + corner_offset(child)};
            const Int3 end = lattice().elements_at(part.level);
            if (max(part.at + Int3{1, 1, 1}, end) == end) {
                visit(part, level_left, left);
            }
        }
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.value_rounding = std::max(counts.value_rounding, attributes_.value_rounding());
        return counts;
    }
    [[nodiscard]] const Lattice& lattice() const { return projection_.lattice(); }

  private:
    static Int3 corner(const Cell& cell, unsigned number) {
        return cell.low() + corner_offset(number) * cell.edge();
    }

    [[nodiscard]] bool is_of_interest(const Cell& cell, double number) {
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (unsigned i = 0; i < 8; ++i) {
            const Int3 node = corner(cell, i);
            const double value =
                query_.plane ? query_.plane->distance(node) : projection_.exact(node, cell.level);
            if (!std::isfinite(value)) {
                return cell.level > 0;
            }
            low = std::min(low, value);
            high = std::max(high, value);
        }
        if (query_.plane) {
            return low < 0 && high >= 0;
        }
        // |U - P U| is below the threshold, |U - U_C| at most the number.
        return may_reach(low, high, number + query_.tolerance.threshold(), query_.iso);
    }

    void march(const Cell& cell, double number, bool cut) {
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
            counts_.error_bound = std::max(counts_.error_bound, number);
        }
        if (mesh_.size() >= part_vertices_) {
            flush();
        }
    }

    const TraversalQuery& query_;
    HexProjection projection_;
    AttributeSampler attributes_;
    LocalMesh mesh_;
    std::size_t part_vertices_;
    const PartSink& sink_;
    Progress& progress_;
    std::uint64_t parts_ = 0;
    TraversalCounts counts_;
};

/// Levels below the coarsest at which the subtrees begin that are the threads' work.
constexpr int kTopLevels = 3;

}  // namespace

TraversalCounts traverse_hexahedra(ChunkCache& cache, const TraversalQuery& query,
                                   std::size_t part_vertices, const PartSink& sink,
                                   Progress& progress) {
    const Lattice& lattice = cache.source().layout().lattice();
    tbb::enumerable_thread_specific<HexWorker> workers(
        [&] { return HexWorker(cache, query, part_vertices, sink, progress); });
    std::vector<Cell> left;
    const Int3 roots = lattice.elements_at(lattice.top());
    HexWorker& first = workers.local();
    first.begin(0);
    for (std::int64_t i = 0; i < roots.product(); ++i) {
        first.visit({lattice.top(), roots.unlinear(i)}, std::max(lattice.top() - kTopLevels, 0),
                    &left);
    }
    first.flush();
    progress.begin("extract", left.size(), "");
    tbb::parallel_for(std::size_t{0}, left.size(), [&](std::size_t i) {
        HexWorker& worker = workers.local();
        worker.begin(i + 1);
        worker.visit(left[i], 0, nullptr);
        worker.flush();
        progress.advance(1);
    });
    TraversalCounts counts;
    for (const HexWorker& worker : workers) {
        counts.add(worker.counts());
    }
    return counts;
}

}  // namespace isonest::detail
