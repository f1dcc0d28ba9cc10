#include "query/simplify/mapping/map_patch.h"

#include <algorithm>
#include <optional>

#include "query/simplify/mapping/star_mapping.h"
#include "query/simplify/sheets/line_collapse.h"
#include "query/simplify/sheets/nodes_passed.h"
#include "query/simplify/sheets/sheet_lines.h"

namespace isonest::detail {
namespace {

class PatchMapper {
  public:
    PatchMapper(MappedPatch& patch, const CollapseLimits& limits)
        : patch_(patch),
          limit_(limits.distance),
          locked_(patch.shared),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          lines_(patch.next_copy, locked_),
          queue_(patch.positions, mesh_, limits.square_estimate),
          collapse_(patch.positions, patch.box, patch.shared, lines_.known(), mesh_),
          mapping_(patch.displacements),
          line_(patch.positions, lines_, locked_, mesh_, collapse_, mapping_) {
        if (patch.kept_nodes) {
            nodes_.emplace(*patch.kept_nodes);
            line_.keep(*nodes_);
        }
    }

    GoneTriangles run() {
        GoneTriangles gone = collapse_stars(
            queue_, collapse_, waiting(), lines_.silent(),
            [this](const EdgeQueue::Edge& edge) { return due(edge); }, [this] { return take(); });
        write_back();
        return gone;
    }

  private:
    /// The first of a vertex's copies waits if one of them does.
    [[nodiscard]] std::vector<bool> waiting() const {
        std::vector<bool> waits = waiting_vertices(patch_.triangles, patch_.tried, locked_);
        for (std::uint32_t v = 0; v < waits.size(); ++v) {
            if (waits[v] && lines_.first(v) != v) {
                waits[lines_.first(v)] = true;
                waits[v] = false;
            }
        }
        return waits;
    }

    float due(const EdgeQueue::Edge& edge) {
        is_line_ = lines_.is_line(edge.from);
        if (is_line_) {
            const double largest = line_.look(edge.from, edge.to, limit_, kMostMappedFold);
            // What comes next is looked for around the first copy.
            collapse_.see(edge.from);
            return largest == LineCollapse::kRefused ? kNever : StarMapping::due_at(largest);
        }
        const float at = mapping_.due(collapse_, edge, limit_);
        return at < kNever && nodes_ &&
                       nodes_->any(collapse_.star(), point_at(patch_.positions[edge.from]), {})
                   ? kNever
                   : at;
    }

    std::uint32_t take() {
        if (is_line_) {
            return line_.take(queue_);
        }
        const std::uint32_t fewer = collapse_.fewer();
        mapping_.take(collapse_);
        collapse_.take();
        return fewer;
    }

    void write_back() {
        std::size_t left = 0;
        for (std::uint32_t t = 0; t < patch_.triangles.size(); ++t) {
            if (!mesh_.is_gone(t)) {
                const PatchTriangle c = mesh_.corners(t);
                patch_.triangles[left] = from_smallest(c);
                patch_.displacements[left] = patch_.displacements[t];
                patch_.tried[left] = is_free(c, locked_);
                ++left;
            }
        }
        patch_.triangles.resize(left);
        patch_.displacements.resize(left);
        patch_.tried.resize(left);
    }

    MappedPatch& patch_;
    double limit_;
    std::vector<bool> locked_;
    CornerMesh mesh_;
    SheetLines lines_;
    EdgeQueue queue_;
    StarCollapse collapse_;
    StarMapping mapping_;
    LineCollapse line_;
    std::optional<NodesPassed> nodes_;
    bool is_line_ = false;  ///< of the edge that was looked at
};

}  // namespace

GoneTriangles map_patch(MappedPatch& patch, const CollapseLimits& limits) {
    return patch.triangles.empty() ? GoneTriangles{} : PatchMapper(patch, limits).run();
}

}  // namespace isonest::detail
