#include "query/simplify/simplify_patch.h"

#include <tsl/robin_map.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "query/mesh/zero_area.h"
#include "query/simplify/collapse.h"
#include "query/simplify/patch_topology.h"
#include "query/simplify/surface_distance.h"
#include "query/simplify/triangle_tree.h"

namespace isonest::detail {
namespace {

/// Errors to be proposed, in shares of the limit. Found by trial on scans: the first makes few
/// misses, so that most of the triangles are gone when those come that make many.
constexpr std::array<double, 5> kErrors{0.2, 0.4, 0.6, 0.8, 1};
constexpr double kFirst = 0.25;   ///< the first error, in edges of the fine triangles, at most
constexpr int kMostHalvings = 6;  ///< of the first of them
constexpr int kMostRetries = 2;
constexpr int kMostRounds = 8;     ///< of measuring
constexpr int kMostAttempts = 12;  ///< at the same topology in each of them
/// How much further around a miss triangles stay in the next round.
constexpr double kFurther = 1.5;
/// A step that leaves more of the triangles than this is the last one.
constexpr double kWorthwhile = 0.97;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

struct TriangleHash {
    std::size_t operator()(const PatchTriangle& t) const {
        std::uint64_t h = (std::uint64_t{t[0]} << 32U | t[1]) * 0x9E3779B97F4A7C15ULL;
        h = (h ^ (h >> 29U) ^ t[2]) * 0xBF58476D1CE4E5B9ULL;
        return static_cast<std::size_t>(h ^ (h >> 32U));
    }
};

/// A number for each triangle that was ever proposed: what was measured of one holds whenever it is
/// proposed again.
class KnownTriangles {
  public:
    std::uint32_t number(const PatchTriangle& t) {
        const auto [slot, is_new] = numbers_.try_emplace(t, next_);
        next_ += is_new ? 1 : 0;
        return slot->second;
    }
    [[nodiscard]] std::uint32_t count() const { return next_; }

  private:
    tsl::robin_map<PatchTriangle, std::uint32_t, TriangleHash> numbers_;
    std::uint32_t next_ = 0;
};

/// Triangles, smallest corner first, sorted.
struct State {
    std::vector<PatchTriangle> triangles;
    std::vector<bool> kept;
    std::vector<std::uint32_t> number;  ///< KnownTriangles
};

class PatchSimplifier {
  public:
    PatchSimplifier(const Patch& patch, double limit)
        : patch_(patch),
          limit_(limit),
          fine_(patch.positions, patch.fine),
          server_(patch.fine.size(), kNone) {
        std::vector<std::pair<PatchTriangle, bool>> sorted;
        sorted.reserve(patch.triangles.size());
        for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
            sorted.emplace_back(from_smallest(patch.triangles[i]), patch.kept[i]);
            if (patch.held[i]) {
                held_.push_back(sorted.back().first);
            }
        }
        std::sort(held_.begin(), held_.end());
        now_ = state_of(sorted);
        covered_.assign(now_.triangles.size(), true);
        topology_.emplace(patch, now_.triangles);
    }

    /// Of the fine triangles.
    [[nodiscard]] double typical_edge() const { return fine_.typical_edge(); }
    enum class Gain : std::uint8_t { none, little, much };
    /// None: all proposals missed.
    Gain step(double error) {
        const std::size_t before = now_.triangles.size();
        std::vector<bool> stays = now_.kept;
        for (std::size_t i = 0; i < stays.size(); ++i) {
            const PatchTriangle& t = now_.triangles[i];
            stays[i] = stays[i] || std::binary_search(held_.begin(), held_.end(), t) ||
                       std::any_of(t.begin(), t.end(), [&](std::uint32_t v) {
                           return topology_->links()[v].shape == LinkShape::tangled;
                       });
        }
        std::optional<TriangleTree> tree;
        double reach = limit_;
        for (int round = 0; round < kMostRounds; ++round, reach *= kFurther) {
            const std::optional<State> next = propose_alike(stays, error);
            if (!next) {
                return Gain::none;
            }
            const std::vector<Double3> bad = misses(*next);
            if (bad.empty()) {
                now_ = *next;
                return static_cast<double>(now_.triangles.size()) <
                               kWorthwhile * static_cast<double>(before)
                           ? Gain::much
                           : Gain::little;
            }
            if (!tree) {
                tree.emplace(patch_.positions, now_.triangles);
            }
            for (const Double3& at : bad) {
                tree->near(at, reach * reach, [&](std::uint32_t i) {
                    stays[i] = true;
                    return false;
                });
            }
        }
        return Gain::none;
    }

    SimplifiedPatch result() {
        SimplifiedPatch simplified;
        std::vector<std::uint32_t> place(known_.count(), kNone);
        for (std::uint32_t i = 0; i < now_.number.size(); ++i) {
            place[now_.number[i]] = i;
        }
        const TriangleTree tree(patch_.positions, now_.triangles);
        SurfaceDistance distance(tree, limit_);
        auto& servers = simplified.servers;
        for (std::size_t i = 0; i < patch_.fine.size(); ++i) {
            simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
            if (!patch_.attached[i]) {
                continue;
            }
            if (server_[i] != kNone && place[server_[i]] != kNone) {
                servers.push_back(place[server_[i]]);
                continue;
            }
            const Triangle t = patch_.at(patch_.fine[i]);
            if (distance.serves(t)) {
                const auto& by = distance.servers();
                servers.insert(servers.end(), by.begin(), by.end());
                continue;
            }
            // It was cut too often; what it is near to is among all these.
            const double reach =
                limit_ + std::sqrt(std::max({square(minus(t[1], t[0])), square(minus(t[2], t[1])),
                                             square(minus(t[0], t[2]))}));
            tree.near(t[0], reach * reach, [&](std::uint32_t server) {
                servers.push_back(server);
                return false;
            });
        }
        simplified.first_server.push_back(static_cast<std::uint32_t>(servers.size()));
        simplified.largest = std::max(largest_, distance.largest());
        simplified.triangles = std::move(now_.triangles);
        simplified.kept = std::move(now_.kept);
        return simplified;
    }

  private:
    State state_of(std::vector<std::pair<PatchTriangle, bool>>& triangles) {
        std::sort(triangles.begin(), triangles.end());
        State state;
        for (const auto& [triangle, kept] : triangles) {
            state.triangles.push_back(triangle);
            state.kept.push_back(kept);
            state.number.push_back(known_.number(triangle));
        }
        return state;
    }

    State propose(const std::vector<bool>& stays, double error) {
        std::vector<PatchTriangle> free;
        std::vector<bool> locked = patch_.shared;
        std::vector<std::pair<PatchTriangle, bool>> all;
        for (std::size_t i = 0; i < stays.size(); ++i) {
            if (!stays[i]) {
                free.push_back(now_.triangles[i]);
                continue;
            }
            all.emplace_back(now_.triangles[i], now_.kept[i]);
            for (const std::uint32_t v : now_.triangles[i]) {
                locked[v] = true;
            }
        }
        if (!free.empty()) {
            for (const PatchTriangle& t : collapse_edges(patch_, free, locked, error)) {
                all.emplace_back(from_smallest(t), false);
            }
        }
        return state_of(all);
    }

    /// A proposal of the same topology: where one has another, the triangles there stay, too.
    std::optional<State> propose_alike(std::vector<bool>& stays, double error) {
        for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
            State next = propose(stays, error);
            const std::vector<std::uint32_t> changes = topology_->changes(next.triangles);
            if (changes.empty()) {
                return next;
            }
            std::vector<bool> changed(patch_.positions.size());
            for (const std::uint32_t v : changes) {
                changed[v] = true;
            }
            for (std::size_t i = 0; i < stays.size(); ++i) {
                const PatchTriangle& t = now_.triangles[i];
                stays[i] = stays[i] || changed[t[0]] || changed[t[1]] || changed[t[2]];
            }
        }
        return std::nullopt;
    }

    /// Where `next` is too far from the fine surface, or that from it.
    std::vector<Double3> misses(const State& next) {
        std::vector<Double3> bad;
        covered_.resize(known_.count());
        SurfaceDistance to_fine(fine_, limit_);
        for (std::size_t i = 0; i < next.triangles.size(); ++i) {
            if (covered_[next.number[i]]) {
                continue;
            }
            const PatchTriangle& t = next.triangles[i];
            const auto& p = patch_.positions;
            if (has_no_area(p[t[0]], p[t[1]], p[t[2]])) {
                bad.push_back(patch_.point(t[0]));
            } else if (!to_fine.covers(patch_.at(t))) {
                bad.push_back(to_fine.miss().at);
            } else {
                covered_[next.number[i]] = true;
            }
        }
        std::vector<bool> is_there(known_.count());
        for (const std::uint32_t n : next.number) {
            is_there[n] = true;
        }
        const TriangleTree tree(patch_.positions, next.triangles);
        SurfaceDistance to_next(tree, limit_);
        for (std::size_t i = 0; i < patch_.fine.size(); ++i) {
            if (!patch_.attached[i] || (server_[i] != kNone && is_there[server_[i]])) {
                continue;
            }
            if (!to_next.serves(patch_.at(patch_.fine[i]))) {
                bad.push_back(to_next.miss().at);
            } else if (to_next.servers().size() == 1) {
                server_[i] = next.number[to_next.servers().front()];
            }
        }
        largest_ = std::max({largest_, to_fine.largest(), to_next.largest()});
        return bad;
    }

    const Patch& patch_;
    double limit_;
    TriangleTree fine_;
    KnownTriangles known_;
    State now_;
    std::vector<PatchTriangle> held_;    ///< sorted
    std::vector<bool> covered_;          ///< by number: near to the fine surface
    std::vector<std::uint32_t> server_;  ///< of each fine triangle: one that it is near to
    std::optional<PatchTopology> topology_;
    double largest_ = 0;
};

}  // namespace

SimplifiedPatch simplify_patch(const Patch& patch, double limit) {
    PatchSimplifier simplifier(patch, limit);
    using Gain = PatchSimplifier::Gain;
    // From small steps to large ones, whose proposals then start from larger triangles. Where the
    // first error misses everywhere, a smaller one is the first.
    double share = kErrors.front();
    for (int i = 0; i < kMostHalvings && share * limit > kFirst * simplifier.typical_edge(); ++i) {
        share /= 2;
    }
    Gain gain = simplifier.step(share * limit);
    for (int i = 0; gain == Gain::none && i < kMostRetries; ++i) {
        share /= 2;
        gain = simplifier.step(share * limit);
    }
    while (gain != Gain::none && 2 * share <= kErrors.front()) {
        share *= 2;
        gain = simplifier.step(share * limit);
    }
    for (std::size_t i = 1; i < kErrors.size() && gain != Gain::none; ++i) {
        const bool was_little = gain == Gain::little;
        gain = simplifier.step(kErrors[i] * limit);
        if (was_little && gain == Gain::little) {
            break;
        }
    }
    return simplifier.result();
}

}  // namespace isonest::detail
