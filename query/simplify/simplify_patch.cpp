#include "query/simplify/simplify_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "query/simplify/collapse/collapse_stars.h"
#include "query/simplify/collapse/placed_collapse.h"
#include "query/simplify/mapping/star_mapping.h"
#include "query/simplify/proof/projected_cover.h"
#include "query/simplify/proof/server_lists.h"
#include "query/simplify/proof/surface_distance.h"
#include "query/simplify/proof/triangle_tree.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

/// Edges of which the estimate says that they are further off, in limits, are not tried. Those
/// between one and two limits are worth it: without them up to 1.8 times as many triangles stay.
constexpr double kFurthestMeasured = 3;

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, const CollapseLimits& limits)
        : patch_(patch),
          positions_(patch.positions),
          limit_(limits.distance),
          locked_(locked_vertices(patch)),
          servers_(patch, positions_, limit_),
          displacements_(patch.displacements),
          mapping_(displacements_) {
        find_servers();
        mesh_.emplace(patch.positions.size(), patch.triangles, locked_);
        queue_.emplace(positions_, *mesh_, limits.square_estimate);
        collapse_.emplace(positions_, patch.box, patch.shared, locked_, *mesh_);
        placed_.emplace(positions_, patch.box, patch.shared, *mesh_);
    }

    SimplifiedPatch run() {
        collapse_stars(
            *queue_, *collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [this](const EdgeQueue::Edge& edge) { return may_go(edge) ? 0 : kNever; },
            [this] { return take(); });
        return result();
    }

  private:
    [[nodiscard]] SimplifiedPatch result() const {
        SimplifiedPatch simplified;
        std::vector<std::uint32_t> place(patch_.triangles.size(), kNoPlace);
        simplified.largest = std::max(found_, servers_.largest());
        for (std::uint32_t i = 0; i < place.size(); ++i) {
            if (mesh_->is_gone(i)) {
                continue;
            }
            const PatchTriangle t = mesh_->corners(i);
            place[i] = static_cast<std::uint32_t>(simplified.triangles.size());
            simplified.triangles.push_back(from_smallest(t));
            simplified.displacements.push_back(displacements_[i]);
            simplified.largest = std::max(simplified.largest, displacements_[i].bound());
            simplified.kept.push_back(patch_.stay[i] == Stay::forever);
            simplified.tried.push_back(is_free(t, locked_));
        }
        for (std::uint32_t v = 0; v < positions_.size(); ++v) {
            if (mesh_->first(v) != CornerMesh::kNone && positions_[v] != patch_.positions[v]) {
                simplified.moved.push_back({v, positions_[v]});
            }
        }
        auto& servers = simplified.servers;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
            for (const std::uint32_t s : servers_.servers_of(i)) {
                servers.push_back(place[s]);
            }
        }
        simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
        return simplified;
    }

    void find_servers() {
        std::optional<TriangleTree> tree;
        std::optional<SurfaceDistance> distance;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            const std::uint32_t& known = patch_.servers[i];
            if (known != kSomeServers) {
                if (known != kNoServer) {
                    servers_.set(i, std::span(&known, 1));
                }
                continue;
            }
            if (!tree) {
                tree.emplace(patch_.positions, patch_.triangles);
                distance.emplace(*tree, limit_);
            }
            const Triangle t = patch_.at(patch_.fine[i]);
            if (distance->serves(t)) {
                found_ = std::max(found_, distance->largest());
                servers_.set(i, distance->servers());
                continue;
            }
            // It was cut too often; what it is near to is among all these, and they stay.
            const double reach =
                limit_ + std::sqrt(std::max({square(minus(t[1], t[0])), square(minus(t[2], t[1])),
                                             square(minus(t[0], t[2]))}));
            std::vector<std::uint32_t> all;
            tree->near(t[0], reach * reach, [&](std::uint32_t server) {
                all.push_back(server);
                for (const std::uint32_t v : patch_.triangles[server]) {
                    locked_[v] = true;
                }
                return false;
            });
            servers_.set(i, all);
        }
    }

    bool may_go(const EdgeQueue::Edge& edge) {
        is_placed_ = false;
        if (!collapse_->look(edge.from, edge.to)) {
            return false;
        }
        return stays_near() || stays_near_at_best_place(edge);
    }

    std::uint32_t take() {
        const std::uint32_t fewer = collapse_->fewer();
        servers_.take();
        if (!is_placed_) {
            mapping_.take(*collapse_);
            collapse_->take();
            return fewer;
        }
        positions_[collapse_->vertex(0)] = placed_->place();
        for (std::size_t i = 0; i < after_.size(); ++i) {
            Displacement measured;
            measured.radius = float_above(measured_off_[i]);
            displacements_[after_[i].triangle] = measured;
        }
        collapse_->take_moved();
        return fewer;
    }

    bool stays_near() {
        if (!may_be_measured(*collapse_)) {
            return false;
        }
        const Star& star = collapse_->star();
        before_.clear();
        after_.clear();
        for (std::size_t i = 0; i < star.corners; ++i) {
            if (i != star.missing) {
                before_.push_back(collapse_->triangle(i));
            }
        }
        for (std::size_t j = 1; j + 1 < star.corners; ++j) {
            after_.push_back({collapse_->triangle(j),
                              PreparedTriangle(triangle_at(positions_, collapse_->after(j)))});
        }
        return servers_.fits(near_of(collapse_->ring().middle), before_, after_, *mesh_) &&
               are_near();
    }

    /// The same with the end of the edge where the quadrics are least.
    bool stays_near_at_best_place(const EdgeQueue::Edge& edge) {
        if (locked_[edge.to]) {
            return false;
        }
        const std::optional<Double3> best = queue_->lowest(edge.from, edge.to);
        if (!best ||
            !placed_->look(*collapse_,
                           {static_cast<float>((*best)[0]), static_cast<float>((*best)[1]),
                            static_cast<float>((*best)[2])}) ||
            !placed_->has_no_new_fold(*collapse_, kMostMeasuredFold)) {
            return false;
        }
        after_.clear();
        for (const PlacedCollapse::Placed& placed : placed_->after()) {
            after_.push_back({placed.triangle, PreparedTriangle(placed.at)});
        }
        if (!servers_.fits(near_of(edge.from), placed_->before(), after_, *mesh_)) {
            return false;
        }
        measured_off_.clear();
        is_placed_ = std::all_of(placed_->after().begin(), placed_->after().end(),
                                 [&](const PlacedCollapse::Placed& placed) {
                                     const std::optional<double> off =
                                         off_of(after_[measured_off_.size()], placed.corners);
                                     measured_off_.push_back(off.value_or(0));
                                     return off.has_value();
                                 });
        return is_placed_;
    }

    /// Whether the new triangles are near to the full surface: as far as they were moved, else
    /// measured.
    bool are_near() {
        const bool is_mapped = mapping_.look(*collapse_);
        measured_.clear();
        for (std::size_t j = 1; j + 1 < collapse_->star().corners; ++j) {
            if (!is_mapped || !(mapping_.map(j) <= limit_)) {
                measured_.push_back(j);
            }
        }
        return std::all_of(measured_.begin(), measured_.end(), [&](std::size_t j) {
            const std::optional<double> off = off_of(after_[j - 1], collapse_->after(j));
            if (off) {
                mapping_.set_measured(j, *off);
            }
            return off.has_value();
        });
    }

    [[nodiscard]] std::uint32_t near_of(std::uint32_t v) const {
        return patch_.near.empty() ? v : patch_.near[v];
    }

    /// From above. `at`: where the triangle's corners will be.
    std::optional<double> off_from_above(const Triangle& at, const PatchTriangle& t) {
        if (!above_) {
            above_.emplace(patch_.positions, patch_.fine, limit_);
        }
        // Best from a corner that is a vertex of the full surface.
        std::size_t first = 3;
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t near = near_of(t[i]);
            if (near == kNoVertex) {
                continue;
            }
            if (patch_.point(near) == at[i]) {
                first = i;
                break;
            }
            first = first == 3 ? i : first;
        }
        return first == 3 ? std::nullopt
                          : above_->covers({at[first], at[(first + 1) % 3], at[(first + 2) % 3]},
                                           near_of(t[first]));
    }

    /// A bound on the distance of a new triangle from the full surface; nothing: above the limit.
    std::optional<double> off_of(const Server& server, const PatchTriangle& t) {
        if (const std::optional<double> off = servers_.served_back(server)) {
            return off;
        }
        if (const std::optional<double> off = off_from_above(server.shape.corners(), t)) {
            return off;
        }
        if (!to_fine_) {
            fine_.emplace(patch_.positions, patch_.fine);
            to_fine_.emplace(*fine_, limit_);
        }
        return to_fine_->covers(server.shape.corners()) ? std::optional(to_fine_->largest())
                                                        : std::nullopt;
    }

    const Patch& patch_;
    std::vector<std::array<float, 3>> positions_;  ///< of the mesh's vertices, as they are by now
    double limit_;
    std::vector<bool> locked_;
    std::optional<TriangleTree> fine_;        ///< made when it is needed
    std::optional<SurfaceDistance> to_fine_;  ///< the same
    std::optional<ProjectedCover> above_;     ///< the same
    ServerLists servers_;
    double found_ = 0;  ///< the most that a fine triangle is from servers that were looked for
    std::vector<Displacement> displacements_;  ///< of each triangle
    StarMapping mapping_;
    std::optional<CornerMesh> mesh_;
    std::optional<EdgeQueue> queue_;
    std::optional<StarCollapse> collapse_;
    std::optional<PlacedCollapse> placed_;
    bool is_placed_ = false;  ///< the edge that was looked at last goes there
    std::vector<std::uint32_t> before_;
    std::vector<Server> after_;
    std::vector<std::size_t> measured_;  ///< new triangles that moved too far to be near by that
    std::vector<double> measured_off_;   ///< of each triangle of placed_
};

}  // namespace

CollapseLimits simplify_limits(double distance) {
    return limits_of(distance, kFurthestMeasured);
}

SimplifiedPatch simplify_patch(const Patch& patch, const CollapseLimits& limits) {
    return PatchSimplifier(patch, limits).run();
}

}  // namespace isonest::detail
