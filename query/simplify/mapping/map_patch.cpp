#include "query/simplify/mapping/map_patch.h"

#include <algorithm>

#include "query/simplify/mapping/star_mapping.h"

namespace isonest::detail {
namespace {

/// Cosine of the angle between normals from which on an edge is a fold: 72 degrees.
constexpr float kFold = 0.309F;

/// An edge comes no sooner than if the quadrics estimated this part of the bound that its collapse
/// leaves. So bounds grow everywhere alike, and heights of both signs make up for each other: 8 to
/// 15 % fewer triangles.
constexpr double kBoundWeight = 0.7;

class PatchMapper {
  public:
    PatchMapper(MappedPatch& patch, const CollapseLimits& limits)
        : patch_(patch),
          limit_(limits.distance),
          locked_(patch.shared),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          queue_(patch.positions, mesh_, limits.square_estimate),
          collapse_(patch.positions, patch.box, patch.shared, locked_, mesh_),
          mapping_(patch.displacements) {}

    GoneTriangles run() {
        GoneTriangles gone = collapse_stars(
            queue_, collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [this](const EdgeQueue::Edge& edge) { return due(edge); },
            [this] {
                mapping_.take(collapse_);
                collapse_.take();
            });
        write_back();
        return gone;
    }

  private:
    float due(const EdgeQueue::Edge& edge) {
        if (!collapse_.look(edge.from, edge.to) || !collapse_.has_no_new_needle() ||
            !collapse_.has_no_new_fold(kFold) || !mapping_.look(collapse_)) {
            return kNever;
        }
        double largest = 0;
        for (std::size_t j = 1; j + 1 < collapse_.star().corners; ++j) {
            largest = std::max(largest, mapping_.map(j));
            if (!(largest <= limit_)) {
                return kNever;
            }
        }
        const double bound = kBoundWeight * largest;
        return static_cast<float>(bound * bound);
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
    EdgeQueue queue_;
    StarCollapse collapse_;
    StarMapping mapping_;
};

}  // namespace

GoneTriangles map_patch(MappedPatch& patch, const CollapseLimits& limits) {
    return patch.triangles.empty() ? GoneTriangles{} : PatchMapper(patch, limits).run();
}

}  // namespace isonest::detail
