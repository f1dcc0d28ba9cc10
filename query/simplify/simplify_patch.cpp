#include "query/simplify/simplify_patch.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <numeric>
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
const double kFurthestMeasured = std::getenv("ISO_F") ? atof(std::getenv("ISO_F")) : 3;
struct Count {
    std::atomic<long> tries{0}, nolook{0}, notmeas{0}, fits{0}, fitfail{0}, near_map{0}, near_meas{0}, near_fail{0}, placed_tries{0}, placed_geo{0}, placed_fit{0}, placed_off{0}, taken{0}, taken_placed{0}, cover{0}, coverok{0}, above{0}, aboveok{0}, back{0}, tree{0}, premapped{0}, open{0}, local{0}, localok{0};
    ~Count() {
        if (std::getenv("ISO_C") == nullptr) return;
        std::fprintf(stderr, "tries %ld nolook %ld notmeas %ld | fits asked %ld failed %ld | near map %ld meas %ld fail %ld | placed %ld geo-ok %ld fit-ok %ld off-ok %ld | taken %ld placed %ld | back %ld above %ld ok %ld cover %ld ok %ld | tree %ld premapped %ld open %ld local %ld ok %ld\n", tries.load(), nolook.load(), notmeas.load(), fits.load(), fitfail.load(), near_map.load(), near_meas.load(), near_fail.load(), placed_tries.load(), placed_geo.load(), placed_fit.load(), placed_off.load(), taken.load(), taken_placed.load(), back.load(), above.load(), aboveok.load(), cover.load(), coverok.load(), tree.load(), premapped.load(), open.load(), local.load(), localok.load());
    }
} count;

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, const CollapseLimits& limits)
        : patch_(patch),
          positions_(patch.positions),
          limit_(limits.distance),
          queue_most_(limits.square_estimate),
          locked_(locked_vertices(patch)),
          servers_(patch, positions_, limit_),
          displacements_(patch.displacements),
          mapping_(displacements_) {
        static const double pre = std::getenv("ISO_PRE") ? atof(std::getenv("ISO_PRE")) : 0;
        static const double pref = std::getenv("ISO_PREF") ? atof(std::getenv("ISO_PREF")) : 1.5;
        const bool is_first = patch.first_pass && pre > 0;
        mesh_.emplace(patch.positions.size(), patch.triangles, locked_);
        if (!is_first) {
            find_servers();
        }
        queue_.emplace(positions_, *mesh_, limits.square_estimate);
        collapse_.emplace(positions_, patch.box, patch.shared, locked_, *mesh_);
        placed_.emplace(positions_, patch.box, patch.shared, *mesh_);
        fails_.resize(positions_.size());
        if (is_first) {
            map_first(pre * limit_, pref * pre * limit_);
        }
    }

    void map_first(double limit, double estimate) {
        static const float fold = std::getenv("ISO_PREFOLD") ? std::strtof(std::getenv("ISO_PREFOLD"), nullptr) : 0.309F;
        static const double weight = std::getenv("ISO_PREW") ? atof(std::getenv("ISO_PREW")) : 0.7;
        static const bool needle = std::getenv("ISO_PREN") == nullptr || atoi(std::getenv("ISO_PREN")) != 0;
        std::vector<std::uint32_t> forward(patch_.triangles.size());
        std::iota(forward.begin(), forward.end(), 0U);
        EdgeQueue queue(positions_, *mesh_, static_cast<float>(estimate * estimate));
        collapse_stars(
            queue, *collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [&](const EdgeQueue::Edge& edge) {
                if (!collapse_->look(edge.from, edge.to) || (needle && !collapse_->has_no_new_needle()) ||
                    !collapse_->has_no_new_fold(fold) || !collapse_->turns_little() || !mapping_.look(*collapse_)) {
                    return kNever;
                }
                double largest = 0;
                for (std::size_t j = 1; j + 1 < collapse_->star().corners; ++j) {
                    largest = std::max(largest, mapping_.map(j));
                    if (!(largest <= limit)) {
                        return kNever;
                    }
                }
                const double bound = weight * largest;
                return static_cast<float>(bound * bound);
            },
            [&] {
                const std::size_t n = collapse_->star().corners;
                const std::size_t missing = collapse_->star().missing;
                if (missing != 0) {
                    forward[collapse_->triangle(0)] = collapse_->triangle(1);
                }
                if (missing != n - 1) {
                    forward[collapse_->triangle(n - 1)] = collapse_->triangle(n - 2);
                }
                const std::uint32_t fewer = collapse_->fewer();
                mapping_.take(*collapse_);
                collapse_->take();
                return fewer;
            });
        std::optional<TriangleTree> tree;
        std::optional<SurfaceDistance> distance;
        std::vector<std::uint32_t> alive;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            std::uint32_t to = i;
            while (forward[to] != to) {
                to = forward[to] = forward[forward[to]];
            }
            if (patch_.servers[i] == kNoServer || servers_.find(i, to, *mesh_)) {
                continue;
            }
            ++count.tree;
            if (!tree) {
                std::vector<PatchTriangle> now;
                for (std::uint32_t t = 0; t < patch_.triangles.size(); ++t) {
                    if (!mesh_->is_gone(t)) {
                        alive.push_back(t);
                        now.push_back(mesh_->corners(t));
                    }
                }
                tree.emplace(positions_, now);
                distance.emplace(*tree, limit_);
            }
            const Triangle t = patch_.at(patch_.fine[i]);
            if (!distance->serves(t)) {
                std::abort();
            }
            found_ = std::max(found_, distance->largest());
            std::vector<std::uint32_t> all;
            for (const std::uint32_t s : distance->servers()) {
                all.push_back(alive[s]);
            }
            servers_.set(i, all);
        }
        long left = 0;
        for (std::uint32_t t = 0; t < patch_.triangles.size(); ++t) {
            left += mesh_->is_gone(t) ? 0 : 1;
        }
        count.premapped += left;
        static const bool fresh = std::getenv("ISO_FRESH") == nullptr || atoi(std::getenv("ISO_FRESH")) != 0;
        if (fresh) {
            queue_.emplace(positions_, *mesh_, queue_most_);
        }
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
        std::vector<std::uint32_t> hint(patch_.positions.size(), kNoServer);
        std::vector<std::uint32_t> open;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            const std::uint32_t& known = patch_.servers[i];
            if (known == kNoServer) {
                continue;
            }
            if (known == kSomeServers) {
                open.push_back(i);
                continue;
            }
            for (const std::uint32_t v : patch_.fine[i]) {
                hint[v] = known & ~kWithOthers;
            }
            if ((known & kWithOthers) == 0) {
                servers_.set(i, std::span(&known, 1));
            } else if (!servers_.find(i, known & ~kWithOthers, *mesh_)) {
                open.push_back(i);
            }
        }
        for (const std::uint32_t i : open) {
            ++count.open;
            const PatchTriangle& f = patch_.fine[i];
            const auto at_v = std::find_if(f.begin(), f.end(), [&](std::uint32_t c) { return hint[c] != kNoServer; });
            if (at_v != f.end() && servers_.find(i, hint[*at_v], *mesh_)) {
                const std::uint32_t s = servers_.servers_of(i).front();
                for (const std::uint32_t v : f) {
                    hint[v] = s;
                }
                continue;
            }
            ++count.tree;
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
        static const std::uint32_t most_fails = std::getenv("ISO_FAIL") ? atoi(std::getenv("ISO_FAIL")) : 1000000;
        auto& [version, failed] = fails_[edge.from];
        if (version != edge.version()) {
            version = edge.version();
            failed = 0;
        }
        if (failed >= most_fails) {
            collapse_->see(edge.from);
            return false;
        }
        ++failed;
        ++count.tries;
        if (!collapse_->look(edge.from, edge.to)) {
            ++count.nolook;
            return false;
        }
        static const bool placed = std::getenv("ISO_PLACED") == nullptr || atoi(std::getenv("ISO_PLACED")) != 0;
        return stays_near() || (placed && stays_near_at_best_place(edge));
    }

    std::uint32_t take() {
        const std::uint32_t fewer = collapse_->fewer();
        ++count.taken;
        count.taken_placed += is_placed_ ? 1 : 0;
        servers_.take();
        if (!is_placed_) {
            mapping_.take(*collapse_);
            collapse_->take();
            return fewer;
        }
        positions_[collapse_->vertex(0)] = placed_->place();
        for (std::size_t i = 0; i < after_.size(); ++i) {
            displacements_[after_[i].triangle] = measured_off_[i];
        }
        collapse_->take_moved();
        return fewer;
    }

    bool stays_near() {
        if (!may_be_measured(*collapse_)) {
            ++count.notmeas;
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
        ++count.fits;
        if (!servers_.fits(near_of(collapse_->ring().middle), before_, after_, *mesh_)) {
            ++count.fitfail;
            return false;
        }
        const bool near = are_near();
        ++(!near ? count.near_fail : measured_.empty() ? count.near_map : count.near_meas);
        return near;
    }

    /// The same with the end of the edge where the quadrics are least.
    bool stays_near_at_best_place(const EdgeQueue::Edge& edge) {
        if (locked_[edge.to]) {
            return false;
        }
        ++count.placed_tries;
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
        ++count.placed_geo;
        if (!servers_.fits(near_of(edge.from), placed_->before(), after_, *mesh_)) {
            return false;
        }
        ++count.placed_fit;
        measured_off_.clear();
        is_placed_ = std::all_of(placed_->after().begin(), placed_->after().end(),
                                 [&](const PlacedCollapse::Placed& placed) {
                                     const std::optional<Displacement> off =
                                         off_of(after_[measured_off_.size()], placed.corners);
                                     measured_off_.push_back(off.value_or(Displacement{}));
                                     return off.has_value();
                                 });
        count.placed_off += is_placed_ ? 1 : 0;
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
            const std::optional<Displacement> off = off_of(after_[j - 1], collapse_->after(j));
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
    std::optional<Displacement> off_from_above(const Triangle& at, const PatchTriangle& t) {
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
        if (first == 3) {
            return std::nullopt;
        }
        const std::optional<double> off = above_->covers(
            {at[first], at[(first + 1) % 3], at[(first + 2) % 3]}, near_of(t[first]));
        return off ? std::optional(above_->displacement(*off)) : std::nullopt;
    }

    /// A bound on the distance of a new triangle from the full surface; nothing: above the limit.
    static Displacement ball(double radius) {
        Displacement d;
        d.radius = float_above(radius);
        return d;
    }
    std::optional<Displacement> off_of(const Server& server, const PatchTriangle& t) {
        if (const std::optional<double> off = servers_.served_back(server)) {
            ++count.back;
            return ball(*off);
        }
        static const std::size_t local = std::getenv("ISO_LOCAL") ? atoi(std::getenv("ISO_LOCAL")) : 0;
        static const std::size_t local_first = std::getenv("ISO_LOCAL1") ? atoi(std::getenv("ISO_LOCAL1")) : 0;
        const std::size_t plans = servers_.planned();
        if (plans <= local_first) {
            ++count.local;
            if (const std::optional<double> off = servers_.covered_back(server)) {
                ++count.localok;
                return ball(*off);
            }
        }
        ++count.above;
        if (const std::optional<Displacement> off = off_from_above(server.shape.corners(), t)) {
            ++count.aboveok;
            return off;
        }
        if (plans > local_first && plans <= local) {
            ++count.local;
            if (const std::optional<double> off = servers_.covered_back(server)) {
                ++count.localok;
                return ball(*off);
            }
        }
        static const bool cover = std::getenv("ISO_COVER") == nullptr || atoi(std::getenv("ISO_COVER")) != 0;
        if (!cover) {
            return std::nullopt;
        }
        ++count.cover;
        if (!to_fine_) {
            fine_.emplace(patch_.positions, patch_.fine);
            to_fine_.emplace(*fine_, limit_);
        }
        const bool ok = to_fine_->covers(server.shape.corners());
        count.coverok += ok ? 1 : 0;
        return ok ? std::optional(ball(to_fine_->largest())) : std::nullopt;
    }

    const Patch& patch_;
    std::vector<std::array<float, 3>> positions_;  ///< of the mesh's vertices, as they are by now
    double limit_;
    float queue_most_;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> fails_;
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
    std::vector<Displacement> measured_off_;   ///< of each triangle of placed_
};

}  // namespace

CollapseLimits simplify_limits(double distance) {
    return limits_of(distance, kFurthestMeasured);
}

SimplifiedPatch simplify_patch(const Patch& patch, const CollapseLimits& limits) {
    return PatchSimplifier(patch, limits).run();
}

}  // namespace isonest::detail
