#include "query/traverse/hexahedra/traverse_hexahedra.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/march/march_hexahedron.h"
#include "query/traverse/each_leaf.h"
#include "query/traverse/hexahedra/cell_needs.h"
#include "query/traverse/remote/look_ahead.h"

namespace isonest::detail {
namespace {

/// Whether the query's surface or plane may pass through a cell.
struct PassesCell {
    const TraversalQuery& query;

    [[nodiscard]] std::optional<Field> field() const {
        return query.plane ? std::nullopt : std::optional(query.stop);
    }
    [[nodiscard]] bool may_hold(const Cell& cell, double number, HexProjection& numbers) const {
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (unsigned i = 0; i < 8; ++i) {
            const Int3 node = cell.low() + corner_offset(i) * cell.edge();
            const double value =
                query.plane ? query.plane->distance(node) : numbers.value(node, cell.level);
            if (!std::isfinite(value)) {
                return cell.level > 0;
            }
            low = std::min(low, value);
            high = std::max(high, value);
        }
        if (query.plane) {
            return low < 0 && high >= 0;
        }
        // U - P U| is below the threshold, |U - U_C| is at most the number.
        return may_reach(low, high, number + query.tolerance.threshold(), query.iso);
    }
};

/// Marches leaves.
class HexMarch : public SubtreeMesh {
  public:
    explicit HexMarch(TraversalRun& run)
        : SubtreeMesh(run),
          projection_(run.cache, run.query.stop, run.query.tolerance.threshold()) {
        if (run.query.attribute_values == nullptr) {
            // NOLINTNEXTLINE(clang-analyzer-core.CallAndMessage): it takes this object for null
            attributes_.take_values(
                [this](const Int3& node) { return projection_.projected(node); });
        }
    }

    [[nodiscard]] HexProjection& numbers() { return projection_; }
    void operator()(const Cell& cell, double number, Overlap where) {
        projection_.forget_largest_number();
        HexCell hex{cell.low(), cell.edge(), projection_.nodes_of(cell.level, cell.at), {}};
        for (unsigned p = 0; p < 27; ++p) {
            if ((hex.nodes >> p & 1U) == 0) {
                continue;
            }
            const Int3 twice = Int3{3, 3, 3}.unlinear(p) * cell.edge();
            const Int3 node = cell.low() + Int3{twice.x / 2, twice.y / 2, twice.z / 2};
            const double value = projection_.projected(node);
            if (!std::isfinite(value)) {
                return;
            }
            hex.value[p] = run_.query.plane ? run_.query.plane->distance(node) : value;
        }
        if (mesh_.march_hex_cell(hex, run_.query.plane ? 0 : run_.query.iso,
                                 where == Overlap::crossing)) {
            count_leaf(std::max(number, projection_.largest_number()));
        }
        flush_if_full();
    }

  private:
    HexProjection projection_;
};

/// Number of levels below the coarsest at which the threads' subtrees start.
constexpr int kTopCells = 3;

}  // namespace

TraversalCounts traverse_hexahedra(TraversalRun& run) {
    const PassesCell interest{run.query};
    const StopsBelow stop{run.query.tolerance, run.query.stop};
    return traverse_subtrees<Cell>(
        run, interest, stop, kTopCells, [&] { return HexMarch(run); },
        [&] {
            return element_scout<Cell>(
                HexProjection(run.cache, run.query.stop, run.query.tolerance.threshold()),
                InBox{run.query.box}, interest, stop, CellNeeds(run, !run.query.plane));
        });
}

}  // namespace isonest::detail
