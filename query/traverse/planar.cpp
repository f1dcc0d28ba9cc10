#include "query/traverse/planar.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <vector>

#include "query/traverse/each_leaf.h"
#include "query/traverse/hexahedra/cell_needs.h"
#include "query/traverse/remote/look_ahead.h"
#include "query/values/node_sampler.h"

namespace isonest::detail {
namespace {

/// Maximum rounding error of the heights scale * value in float32; if the box cuts the triangle,
/// also of heights in between.
double height_rounding(const std::array<Corner, 3>& corners, double scale, bool cut) {
    double most = 0;
    for (const Corner& corner : corners) {
        const double height = scale * corner.value;
        const auto stored = static_cast<float>(height);
        most = std::max(most, std::fabs(static_cast<double>(stored) - height) +
                                  std::fabs(std::fma(scale, corner.value, -height)));
        if (cut) {
            const float size = std::fabs(stored);
            const float next = std::nextafter(size, std::numeric_limits<float>::infinity());
            most = std::max(most, static_cast<double>(next) - static_cast<double>(size));
        }
    }
    return most;
}

/// The corners of a leaf; nothing if a value is missing.
std::optional<std::array<Corner, 3>> corners_of(const Element<2>& leaf) {
    if (!leaf.is_complete()) {
        return std::nullopt;
    }
    std::array<Corner, 3> corners;
    for (std::size_t i = 0; i < 3; ++i) {
        corners[i] = {leaf.v[i], leaf.value[i]};
    }
    return corners;
}

class MarchLines : public SubtreeMesh {
  public:
    explicit MarchLines(TraversalRun& run) : SubtreeMesh(run), numbers_(run.cache) {}

    [[nodiscard]] NodeSampler& numbers() { return numbers_; }
    void operator()(const Element<2>& leaf, double eta, Overlap where) {
        if (const auto corners = corners_of(leaf)) {
            count_leaf(eta);
            mesh_.march_line(*corners, run_.query.iso, where == Overlap::crossing);
            flush_if_full();
        }
    }

  private:
    NodeSampler numbers_;
};

/// Common part of graphs over all elements.
class GraphMesh : public SubtreeMesh {
  public:
    explicit GraphMesh(TraversalRun& run)
        : SubtreeMesh(run), scale_(run.query.attributes.graph_scale.value_or(1)) {}

  protected:
    void add_triangle(const std::array<Corner, 3>& corners, bool cut) {
        mesh_.add_graph(corners, cut);
        counts_.height_rounding =
            std::max(counts_.height_rounding, height_rounding(corners, scale_, cut));
    }

  private:
    double scale_;
};

class TriangleGraph : public GraphMesh {
  public:
    explicit TriangleGraph(TraversalRun& run) : GraphMesh(run), numbers_(run.cache) {}

    [[nodiscard]] NodeSampler& numbers() { return numbers_; }
    void operator()(const Element<2>& leaf, double eta, Overlap where) {
        if (const auto corners = corners_of(leaf)) {
            count_leaf(eta);
            add_triangle(*corners, where == Overlap::crossing);
            flush_if_full();
        }
    }

  private:
    NodeSampler numbers_;
};

/// Corners and midpoints of edges, counterclockwise from the low corner, in half edges.
constexpr std::array<Int3, 8> kAround{
    {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}, {0, 2, 0}, {0, 1, 0}}};

class QuadrilateralGraph : public GraphMesh {
  public:
    explicit QuadrilateralGraph(TraversalRun& run)
        : GraphMesh(run),
          is_finest_(run.query.tolerance.is_zero()),
          projection_(run.cache, run.query.stop, run.query.tolerance.threshold()) {}

    [[nodiscard]] HexProjection& numbers() { return projection_; }
    void operator()(const Cell& cell, double number, Overlap where) {
        const bool cut = where == Overlap::crossing;
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
        count_leaf(number);
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
        flush_if_full();
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = SubtreeMesh::counts();
        counts.stopped_at = std::max(counts.stopped_at, projection_.largest_number());
        return counts;
    }

  private:
    [[nodiscard]] double value(const Int3& node) {
        return is_finest_ ? projection_.value(node, 0) : projection_.projected(node);
    }

    /// The centre of the bilinear function.
    [[nodiscard]] Corner centre_of(const Cell& cell) {
        double sum = 0;
        for (std::size_t i = 0; i < 8; i += 2) {
            const Int3& o = kAround[i];
            sum += projection_.projected((cell.at + Int3{o.x / 2, o.y / 2, 0}) * cell.edge());
        }
        return {projection_.lattice().centre_of(cell.level, cell.at), sum / 4};
    }

    bool is_finest_;  ///< everything is refined to the finest level, and no field is needed
    HexProjection projection_;
};

/// Number of levels below the coarsest at which the threads' subtrees start: at most 2 * 4^5 of
/// them.
constexpr int kTopLevels = 5;

/// Traverses triangles.
template <class Action, class Interest>
TraversalCounts traverse_triangles(TraversalRun& run, const Interest& interest, LeafReads reads) {
    const StopsBelow stop{run.query.tolerance, run.query.stop};
    std::vector<Field> asked;
    for (const std::optional<Field>& field : {interest.field(), stop.field()}) {
        if (field) {
            asked.push_back(*field);
        }
    }
    return traverse_subtrees<Element<2>>(
        run, interest, stop, kTopLevels, [&] { return Action(run); },
        [&] {
            return element_scout<Element<2>>(NodeSampler(run.cache), InBox{run.query.box}, interest,
                                             stop, SimplexNeeds(run, asked, reads));
        });
}

TraversalCounts traverse_quadrilaterals(TraversalRun& run) {
    const StopsBelow stop{run.query.tolerance, run.query.stop};
    return traverse_subtrees<Cell>(
        run, Everything{}, stop, kTopLevels, [&] { return QuadrilateralGraph(run); },
        [&] {
            return element_scout<Cell>(
                HexProjection(run.cache, run.query.stop, run.query.tolerance.threshold()),
                InBox{run.query.box}, Everything{}, stop, CellNeeds(run, false));
        });
}

}  // namespace

TraversalCounts traverse_planar(TraversalRun& run, PlanarKind kind) {
    if (kind == PlanarKind::isolines) {
        const HoldsIsovalue interest{run.query.iso, run.query.bound, run.layout().header().steps()};
        return traverse_triangles<MarchLines>(run, interest, LeafReads::edges);
    }
    return run.query.cells == Cells::hexahedra
               ? traverse_quadrilaterals(run)
               : traverse_triangles<TriangleGraph>(run, Everything{}, LeafReads::nodes);
}

}  // namespace isonest::detail
