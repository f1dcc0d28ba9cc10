#include "query/simplify/simplify_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "query/simplify/collapse_order.h"
#include "query/simplify/patch_topology.h"
#include "query/simplify/projected_cover.h"
#include "query/simplify/server_lists.h"
#include "query/simplify/surface_distance.h"
#include "query/simplify/triangle_tree.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// Edges of which the estimate says that they are further off, in limits, are not tried. Those
/// between one and two limits are worth it: without them up to 1.8 times as many triangles stay.
constexpr double kFurthest = 3;

/// Locks all vertices of triangles that have to stay, and of those at vertices around which the
/// triangles are neither a disk nor half of one.
std::vector<bool> locked_vertices(const Patch& patch, const std::vector<Link>& links) {
    std::vector<bool> locked = patch.shared;
    for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
        const PatchTriangle& t = patch.triangles[i];
        if (patch.stay[i] != Stay::no || std::any_of(t.begin(), t.end(), [&](std::uint32_t v) {
                return links[v].shape == LinkShape::tangled;
            })) {
            for (const std::uint32_t v : t) {
                locked[v] = true;
            }
        }
    }
    return locked;
}

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, double limit, std::vector<bool> locked)
        : patch_(patch),
          limit_(limit),
          locked_(std::move(locked)),
          fine_(patch.positions, patch.fine),
          to_fine_(fine_, limit),
          above_(patch.positions, patch.fine, limit),
          servers_(patch, limit) {
        find_servers();
        mesh_.emplace(patch, locked_);
        order_.emplace(patch, *mesh_, locked_, kFurthest * limit);
    }

    void run() {
        std::vector<bool> waits(patch_.positions.size());
        for (std::size_t i = 0; i < patch_.triangles.size(); ++i) {
            for (const std::uint32_t v : patch_.triangles[i]) {
                waits[v] = waits[v] || (!patch_.tried[i] && !locked_[v]);
            }
        }
        for (std::uint32_t v = 0; v < waits.size(); ++v) {
            if (waits[v]) {
                order_->add(v);
            }
        }
        while (const auto next = order_->next()) {
            if (mesh_->is_allowed(next->from, next->to) && stays_near(next->from, next->to)) {
                servers_.take();
                mesh_->collapse(next->from, next->to);
                order_->collapsed(next->from, next->to);
            }
        }
    }

    /// Of the patch as it is now.
    [[nodiscard]] std::vector<PatchTriangle> triangles() const {
        std::vector<PatchTriangle> left;
        for (const PatchTriangle& t : mesh_->triangles()) {
            if (!CollapsingPatch::is_gone(t)) {
                left.push_back(from_smallest(t));
            }
        }
        return left;
    }

    [[nodiscard]] SimplifiedPatch result() const {
        SimplifiedPatch simplified;
        std::vector<std::uint32_t> place(patch_.triangles.size(), kNone);
        for (std::size_t i = 0; i < place.size(); ++i) {
            const PatchTriangle& t = mesh_->triangles()[i];
            if (CollapsingPatch::is_gone(t)) {
                continue;
            }
            place[i] = static_cast<std::uint32_t>(simplified.triangles.size());
            simplified.triangles.push_back(from_smallest(t));
            simplified.kept.push_back(patch_.stay[i] == Stay::forever);
            simplified.tried.push_back(
                std::none_of(t.begin(), t.end(), [&](std::uint32_t v) { return locked_[v]; }));
        }
        auto& servers = simplified.servers;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
            for (const std::uint32_t s : servers_.servers_of(i)) {
                servers.push_back(place[s]);
            }
        }
        simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
        simplified.largest =
            std::max({largest_, servers_.largest(), to_fine_.largest(), above_.largest()});
        return simplified;
    }

  private:
    void find_servers() {
        const TriangleTree tree(patch_.positions, patch_.triangles);
        SurfaceDistance distance(tree, limit_);
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            if (!patch_.attached[i]) {
                continue;
            }
            if (i < patch_.triangles.size() && patch_.fine[i] == patch_.triangles[i]) {
                servers_.set(i, std::span(&i, 1));
                continue;
            }
            const Triangle t = patch_.at(patch_.fine[i]);
            if (distance.serves(t)) {
                servers_.set(i, distance.servers());
                continue;
            }
            // It was cut too often; what it is near to is among all these, and they stay.
            const double reach =
                limit_ + std::sqrt(std::max({square(minus(t[1], t[0])), square(minus(t[2], t[1])),
                                             square(minus(t[0], t[2]))}));
            std::vector<std::uint32_t> all;
            tree.near(t[0], reach * reach, [&](std::uint32_t server) {
                all.push_back(server);
                for (const std::uint32_t v : patch_.triangles[server]) {
                    locked_[v] = true;
                }
                return false;
            });
            servers_.set(i, all);
        }
        largest_ = distance.largest();
    }

    bool stays_near(std::uint32_t from, std::uint32_t to) {
        const auto& around = mesh_->around(from);
        after_.clear();
        for (const std::uint32_t i : around) {
            const PatchTriangle& t = mesh_->triangles()[i];
            if (!CollapsingPatch::has(t, to)) {
                after_.push_back({i, patch_.at(CollapsingPatch::moved(t, from, to))});
            }
        }
        return !after_.empty() && servers_.fits(from, around, after_, mesh_->triangles()) &&
               std::all_of(after_.begin(), after_.end(), [&](const Server& s) {
                   const PatchTriangle t =
                       CollapsingPatch::moved(mesh_->triangles()[s.triangle], from, to);
                   return servers_.is_served_back(s) || above_.covers(t) ||
                          to_fine_.covers(s.corners);
               });
    }

    const Patch& patch_;
    double limit_;
    std::vector<bool> locked_;
    TriangleTree fine_;
    SurfaceDistance to_fine_;
    ProjectedCover above_;
    ServerLists servers_;
    std::optional<CollapsingPatch> mesh_;
    std::optional<CollapseOrder> order_;
    std::vector<Server> after_;
    double largest_ = 0;
};

}  // namespace

SimplifiedPatch simplify_patch(const Patch& patch, double limit) {
    std::vector<PatchTriangle> before(patch.triangles.size());
    std::transform(patch.triangles.begin(), patch.triangles.end(), before.begin(),
                   from_smallest<std::uint32_t>);
    const PatchTopology topology(patch, before);
    std::vector<bool> locked = locked_vertices(patch, topology.links());
    // Collapses that are allowed leave the topology; this is where it is seen.
    while (true) {
        PatchSimplifier simplifier(patch, limit, locked);
        simplifier.run();
        const std::vector<std::uint32_t> changes = topology.changes(simplifier.triangles());
        if (changes.empty()) {
            return simplifier.result();
        }
        if (std::all_of(changes.begin(), changes.end(),
                        [&](std::uint32_t v) { return locked[v]; })) {
            locked.assign(locked.size(), true);
        }
        for (const std::uint32_t v : changes) {
            locked[v] = true;
        }
    }
}

}  // namespace isonest::detail
