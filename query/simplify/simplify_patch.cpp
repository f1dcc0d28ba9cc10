#include "query/simplify/simplify_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/collapse/star_mapping.h"
#include "query/simplify/proof/projected_cover.h"
#include "query/simplify/proof/surface_distance.h"
#include "query/simplify/proof/witness_lists.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

/// Edges with a larger estimate, as a multiple of the limit, are not tried. Trying them leaves a
/// tenth to a third fewer triangles and takes longer by the same proportion, because most of them
/// are measured needlessly.
constexpr double kFurthestMeasured = 1;

/// If more fine triangles than this are concerned, the projection is tried first; with more than
/// kMaxAsked they are not checked at all.
constexpr std::size_t kFewAsked = 20;
constexpr std::size_t kMaxAsked = 1000;

/// Searches for witnesses among all triangles of a mesh.
class WitnessSearch {
  public:
    /// `places`: number of triangle indices of the mesh; some triangles may be removed.
    WitnessSearch(std::span<const std::array<float, 3>> positions, const CornerMesh& mesh,
                  std::size_t places, double limit)
        : limit_(limit),
          place_(those_left(mesh, places)),
          tree_(positions, corners_of(mesh, place_)),
          distance_(tree_, limit) {}

    /// Distance of `t` from the witnesses found; nothing: none were found.
    std::optional<double> serves(const Triangle& t) {
        if (!distance_.serves(t)) {
            return std::nullopt;
        }
        found_.clear();
        for (const std::uint32_t i : distance_.witnesses()) {
            found_.push_back(place_[i]);
        }
        return distance_.largest();
    }
    /// Finds all triangles that a part of `t` may be near.
    void all_near(const Triangle& t) {
        const double reach =
            limit_ + std::sqrt(std::max({square(minus(t[1], t[0])), square(minus(t[2], t[1])),
                                         square(minus(t[0], t[2]))}));
        found_.clear();
        tree_.near(t[0], reach * reach, [&](std::uint32_t i) {
            found_.push_back(place_[i]);
            return false;
        });
    }
    /// Indices in the mesh.
    [[nodiscard]] const std::vector<std::uint32_t>& found() const { return found_; }

  private:
    static std::vector<std::uint32_t> those_left(const CornerMesh& mesh, std::size_t places) {
        std::vector<std::uint32_t> left;
        for (std::uint32_t i = 0; i < places; ++i) {
            if (!mesh.is_gone(i)) {
                left.push_back(i);
            }
        }
        return left;
    }
    static std::vector<PatchTriangle> corners_of(const CornerMesh& mesh,
                                                 const std::vector<std::uint32_t>& places) {
        std::vector<PatchTriangle> corners(places.size());
        std::transform(places.begin(), places.end(), corners.begin(),
                       [&](std::uint32_t i) { return mesh.corners(i); });
        return corners;
    }

    double limit_;
    std::vector<std::uint32_t> place_;  ///< index in the mesh, for each triangle of the tree
    TriangleTree tree_;
    SurfaceDistance distance_;
    std::vector<std::uint32_t> found_;
};

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, const CollapseLimits& limits)
        : patch_(patch),
          positions_(patch.positions),
          limit_(limits.distance),
          locked_(locked_vertices(patch)),
          witnesses_(patch, positions_, limit_),
          displacements_(patch.displacements),
          mapping_(displacements_) {
        mesh_.emplace(patch.positions.size(), patch.triangles, locked_);
        std::vector<std::uint32_t> witnesses = patch.witnesses;
        if (!patch.is_full) {
            find_witnesses(witnesses);
        }
        collapse_.emplace(positions_, patch.box, patch.shared, locked_, *mesh_);
        if (patch.is_full) {
            map(witnesses);
            find_witnesses(witnesses);
        }
        queue_.emplace(positions_, *mesh_, limits.square_estimate);
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
        simplified.largest = std::max(found_, witnesses_.largest());
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
        auto& witnesses = simplified.witnesses;
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            simplified.first_witness.push_back(static_cast<std::uint32_t>(witnesses.size()));
            for (const std::uint32_t s : witnesses_.witnesses_of(i)) {
                witnesses.push_back(place[s]);
            }
        }
        simplified.first_witness.push_back(static_cast<std::uint32_t>(witnesses.size()));
        return simplified;
    }

    /// Collapses what stays near by its displacements alone, without checking fine triangles. Each
    /// fine triangle, which is one of the patch, is then near the surroundings of the triangle that
    /// replaced it: `witnesses`.
    void map(std::vector<std::uint32_t>& witnesses) {
        std::vector<std::uint32_t> place(patch_.triangles.size());
        std::iota(place.begin(), place.end(), 0U);
        EdgeQueue queue(positions_, *mesh_, limits_of(limit_, kFurthestMapped).square_estimate);
        collapse_stars(
            queue, *collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [this](const EdgeQueue::Edge& edge) { return mapping_.due(*collapse_, edge, limit_); },
            [&] {
                const std::size_t n = collapse_->star().corners;
                if (collapse_->star().missing != 0) {
                    place[collapse_->triangle(0)] = collapse_->triangle(1);
                }
                if (collapse_->star().missing != n - 1) {
                    place[collapse_->triangle(n - 1)] = collapse_->triangle(n - 2);
                }
                const std::uint32_t fewer = collapse_->fewer();
                mapping_.take(*collapse_);
                collapse_->take();
                return fewer;
            });
        for (std::uint32_t i = 0; i < witnesses.size(); ++i) {
            std::uint32_t at = i;
            while (place[at] != at) {
                at = place[at] = place[place[at]];
            }
            witnesses[i] = at | kWithOthers;
        }
    }

    /// `known`: as Patch::witnesses, for the current mesh.
    void find_witnesses(const std::vector<std::uint32_t>& known) {
        std::vector<std::uint32_t> near(patch_.positions.size(), kNoWitness);  // of each vertex
        std::optional<WitnessSearch> search;
        const auto find = [&](std::uint32_t fine, std::uint32_t hint) {
            if (hint != kNoWitness && witnesses_.find(fine, hint, *mesh_)) {
                return;
            }
            if (!search) {
                search.emplace(positions_, *mesh_, patch_.triangles.size(), limit_);
            }
            const Triangle t = patch_.at(patch_.fine[fine]);
            if (const std::optional<double> off = search->serves(t)) {
                found_ = std::max(found_, *off);
            } else {
                // It was divided too often; its witnesses are among all of these, which are kept.
                search->all_near(t);
                for (const std::uint32_t witness : search->found()) {
                    for (const std::uint32_t v : mesh_->corners(witness)) {
                        locked_[v] = true;
                    }
                }
            }
            witnesses_.set(fine, search->found());
        };
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            if (known[i] == kNoWitness || known[i] == kSomeWitnesses) {
                continue;
            }
            const std::uint32_t witness = known[i] & ~kWithOthers;
            for (const std::uint32_t v : patch_.fine[i]) {
                near[v] = witness;
            }
            if (known[i] == witness) {
                witnesses_.set(i, std::span(&witness, 1));
            } else {
                find(i, witness);
            }
        }
        for (std::uint32_t i = 0; i < patch_.fine.size(); ++i) {
            if (known[i] == kSomeWitnesses) {
                const PatchTriangle& t = patch_.fine[i];
                const auto v = std::find_if(t.begin(), t.end(),
                                            [&](std::uint32_t c) { return near[c] != kNoWitness; });
                find(i, v == t.end() ? kNoWitness : near[*v]);
            }
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
        witnesses_.take();
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
        return witnesses_.fits(near_of(collapse_->ring().middle), before_, after_, *mesh_) &&
               are_near();
    }

    /// The same with the end of the edge at the minimum of the quadrics.
    bool stays_near_at_best_place(const EdgeQueue::Edge& edge) {
        // The position is the same for both directions of an edge.
        if (locked_[edge.to] || queue_->comes_later_than_back(edge)) {
            return false;
        }
        const std::optional<Double3> best = queue_->lowest(edge.from, edge.to);
        if (!best ||
            !placed_->look(*collapse_,
                           {static_cast<float>((*best)[0]), static_cast<float>((*best)[1]),
                            static_cast<float>((*best)[2])}) ||
            !placed_->has_no_new_fold(*collapse_, kMaxMeasuredFold)) {
            return false;
        }
        after_.clear();
        for (const PlacedCollapse::Placed& placed : placed_->after()) {
            after_.push_back({placed.triangle, PreparedTriangle(placed.at)});
        }
        if (!witnesses_.fits(near_of(edge.from), placed_->before(), after_, *mesh_)) {
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

    /// Whether the new triangles are near the full surface: by their movement, otherwise by
    /// measuring.
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

    /// By projection. `at`: future positions of the triangle's corners.
    std::optional<double> off_from_above(const Triangle& at, const PatchTriangle& t) {
        if (!above_) {
            above_.emplace(patch_.positions, patch_.fine, limit_);
        }
        // Preferably from a corner that is a vertex of the full surface.
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

    /// A bound of the distance of a new triangle from the full surface; nothing: above the limit.
    std::optional<double> off_of(const Witness& witness, const PatchTriangle& t) {
        if (const std::optional<double> off = witnesses_.served_back(witness)) {
            return off;
        }
        if (witnesses_.asked() <= kFewAsked) {
            if (const std::optional<double> off = witnesses_.covered_back(witness)) {
                return off;
            }
        }
        if (const std::optional<double> off = off_from_above(witness.shape.corners(), t)) {
            return off;
        }
        return witnesses_.asked() > kFewAsked && witnesses_.asked() <= kMaxAsked
                   ? witnesses_.covered_back(witness)
                   : std::nullopt;
    }

    const Patch& patch_;
    std::vector<std::array<float, 3>> positions_;  ///< current positions of the mesh's vertices
    double limit_;
    std::vector<bool> locked_;
    std::optional<ProjectedCover> above_;  ///< created when needed
    WitnessLists witnesses_;
    double found_ = 0;  ///< maximum distance of a fine triangle from witnesses that were searched
    std::vector<Displacement> displacements_;  ///< of each triangle
    StarMapping mapping_;
    std::optional<CornerMesh> mesh_;
    std::optional<EdgeQueue> queue_;
    std::optional<StarCollapse> collapse_;
    std::optional<PlacedCollapse> placed_;
    bool is_placed_ = false;  ///< the last examined edge uses that position
    std::vector<std::uint32_t> before_;
    std::vector<Witness> after_;
    std::vector<std::size_t> measured_;  ///< new triangles that moved too far to be near without
                                         ///< measuring
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
