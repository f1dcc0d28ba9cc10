#include "query/simplify/simplify_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "query/simplify/collapse/collapse_edges.h"
#include "query/simplify/collapse/fold_rule.h"
#include "query/simplify/proof/projected_cover.h"
#include "query/simplify/proof/server_lists.h"
#include "query/simplify/proof/star_displacement.h"
#include "query/simplify/proof/surface_distance.h"
#include "query/simplify/proof/triangle_tree.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

/// Edges of which the estimate says that they are further off, in limits, are not tried. Those
/// between one and two limits are worth it: without them up to 1.8 times as many triangles stay.
constexpr double kFurthest = 3;

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, double limit, std::vector<bool> locked)
        : patch_(patch),
          limit_(limit),
          locked_(std::move(locked)),
          star_(patch.positions),
          servers_(patch, limit),
          off_(patch.triangles.size()) {
        find_servers();
        mesh_.emplace(patch, locked_);
        order_.emplace(patch, *mesh_, locked_, kFurthest * limit);
        folds_.emplace(patch, *mesh_);
    }

    void run() {
        collapse_edges(
            patch_, locked_, *mesh_, *order_,
            [this](std::uint32_t from, std::uint32_t to) { return stays_near(from, to); },
            [this] { take(); });
    }

    /// Of the patch as it is now.
    [[nodiscard]] std::vector<PatchTriangle> triangles() const { return triangles_left(*mesh_); }

    [[nodiscard]] SimplifiedPatch result() const {
        SimplifiedPatch simplified;
        std::vector<std::uint32_t> place(patch_.triangles.size(), kNoPlace);
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
        simplified.largest = std::max(largest_, servers_.largest());
        return simplified;
    }

  private:
    void find_servers() {
        for (std::size_t i = 0; i < off_.size(); ++i) {
            const bool is_fine = i < patch_.fine.size() && patch_.fine[i] == patch_.triangles[i];
            off_[i] = is_fine ? 0 : limit_;
        }
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
                largest_ = std::max(largest_, distance.largest());
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
        return !after_.empty() && folds_->allows(from, to) &&
               servers_.fits(from, around, after_, mesh_->triangles()) &&
               (moves_little(from, to) || are_covered(from, to));
    }

    /// Whether the new triangles are so near to the old ones that the full surface is near.
    bool moves_little(std::uint32_t from, std::uint32_t to) {
        double most = 0;
        star_.opposite().clear();
        for (const std::uint32_t i : mesh_->around(from)) {
            const PatchTriangle& t = mesh_->triangles()[i];
            const std::size_t k = t[0] == from ? 0 : t[1] == from ? 1 : 2;
            star_.opposite().push_back({t[(k + 1) % 3], t[(k + 2) % 3]});
            most = std::max(most, off_[i]);
        }
        if (!(most < limit_)) {
            return false;
        }
        const std::optional<double> moved = star_.of(from, to);
        if (!moved || most + *moved > limit_) {
            return false;
        }
        after_off_.assign(after_.size(), most + *moved);
        return true;
    }

    bool are_covered(std::uint32_t from, std::uint32_t to) {
        after_off_.clear();
        return std::all_of(after_.begin(), after_.end(), [&](const Server& s) {
            const std::optional<double> off =
                off_of(s, CollapsingPatch::moved(mesh_->triangles()[s.triangle], from, to));
            after_off_.push_back(off.value_or(limit_));
            return off.has_value();
        });
    }

    /// A bound on the distance of a new triangle from the full surface; nothing: above the limit.
    std::optional<double> off_of(const Server& server, const PatchTriangle& t) {
        if (const std::optional<double> off = servers_.served_back(server)) {
            return off;
        }
        if (!above_) {
            above_.emplace(patch_.positions, patch_.fine, limit_);
        }
        if (const std::optional<double> off = above_->covers(t)) {
            return off;
        }
        if (!to_fine_) {
            fine_.emplace(patch_.positions, patch_.fine);
            to_fine_.emplace(*fine_, limit_);
        }
        return to_fine_->covers(server.corners) ? std::optional(to_fine_->largest()) : std::nullopt;
    }

    void take() {
        servers_.take();
        for (std::size_t i = 0; i < after_.size(); ++i) {
            off_[after_[i].triangle] = after_off_[i];
            largest_ = std::max(largest_, after_off_[i]);
        }
    }

    const Patch& patch_;
    double limit_;
    std::vector<bool> locked_;
    std::optional<TriangleTree> fine_;        ///< made when it is needed
    std::optional<SurfaceDistance> to_fine_;  ///< the same
    std::optional<ProjectedCover> above_;     ///< the same
    StarDisplacement star_;
    ServerLists servers_;
    std::vector<double> off_;  ///< of each triangle: no point of it is further off
    std::optional<CollapsingPatch> mesh_;
    std::optional<CollapseOrder> order_;
    std::optional<FoldRule> folds_;
    std::vector<Server> after_;
    std::vector<double> after_off_;
    double largest_ = 0;
};

}  // namespace

SimplifiedPatch simplify_patch(const Patch& patch, double limit) {
    return with_same_topology(patch, [&](const std::vector<bool>& locked) {
        return PatchSimplifier(patch, limit, locked);
    });
}

}  // namespace isonest::detail
