#include "query/simplify/mapping/map_patch.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "query/simplify/mapping/corner_mesh.h"
#include "query/simplify/mapping/edge_queue.h"
#include "query/simplify/mapping/fan_overlay.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = CornerMesh::kNone;
/// Cosine of the angle between normals from which on an edge is a fold: 72 degrees.
constexpr float kFold = 0.309F;
/// A triangle is thin if its height is less than this part of its longest edge: 5 degrees, nearly.
constexpr float kThin = 0.087F;

/// An edge comes no sooner than if the quadrics estimated this part of the bound that its collapse
/// leaves. So bounds grow everywhere alike, and heights of both signs make up for each other: 8 to
/// 15 % fewer triangles.
constexpr double kBoundWeight = 0.7;
/// Bins (edge_queue.h) by which it is not worth waiting.
constexpr std::size_t kNoWait = 8;

using Normal = std::array<float, 3>;

float cosine(const Normal& a, const Normal& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

class PatchMapper {
  public:
    PatchMapper(MappedPatch& patch, const MappingLimits& limits)
        : patch_(patch),
          limit_(limits.distance),
          locked_(patch.shared),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          queue_(patch.positions, mesh_, limits.square_estimate),
          normals_(patch.triangles.size()) {
        for (std::uint32_t t = 0; t < normals_.size(); ++t) {
            const PatchTriangle& c = patch.triangles[t];
            normals_[t] = normal(point(c[0]), point(c[1]), point(c[2]));
        }
    }

    MappingResult run() {
        std::vector<bool> waits(patch_.positions.size());
        for (std::size_t i = 0; i < patch_.triangles.size(); ++i) {
            for (const std::uint32_t v : patch_.triangles[i]) {
                waits[v] = waits[v] || (!patch_.tried[i] && !locked_[v]);
            }
        }
        for (std::uint32_t v = 0; v < waits.size(); ++v) {
            if (waits[v]) {
                queue_.add(v);
            }
        }
        MappingResult result;
        std::size_t largest = 0;
        while (const auto edge = queue_.next()) {
            if (!is_possible(edge->from, edge->to)) {
                queue_.stays(*edge, ring_);
                continue;
            }
            const double bound = kBoundWeight * overlay_.largest();
            const auto square_bound = static_cast<float>(bound * bound);
            if (bin_of(square_bound) > queue_.bin() + kNoWait) {
                queue_.stays(*edge, ring_);
                queue_.defer(*edge, square_bound);
                continue;
            }
            largest = std::max(largest, queue_.bin());
            if (largest >= result.gone_at.size()) {
                result.gone_at.resize(largest + 1);
            }
            result.gone_at[largest] += ring_.is_closed ? 2 : 1;
            take();
            queue_.collapsed(edge->from, ring_, locked_);
        }
        write_back();
        return result;
    }

  private:
    [[nodiscard]] Double3 point(std::uint32_t v) const {
        const auto& p = patch_.positions[v];
        return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
    }
    static Normal normal(const Double3& a, const Double3& b, const Double3& c) {
        const Double3 n = cross(minus(b, a), minus(c, a));
        const double size = length(n);
        if (!(size > 0)) {
            return {};
        }
        return {static_cast<float>(n[0] / size), static_cast<float>(n[1] / size),
                static_cast<float>(n[2] / size)};
    }
    /// The faces of the box that a vertex lies in, as bits.
    [[nodiscard]] unsigned faces_of(std::uint32_t v) const {
        unsigned faces = 0;
        for (unsigned axis = 0; axis < 3; ++axis) {
            const float x = patch_.positions[v][axis];
            faces |= x == patch_.box.lo[axis] ? 1U << (2 * axis) : 0U;
            faces |= x == patch_.box.hi[axis] ? 2U << (2 * axis) : 0U;
        }
        return faces;
    }

    bool is_possible(std::uint32_t from, std::uint32_t to) {
        mesh_.ring_of(from, ring_);
        const auto at = std::find(ring_.vertices.begin(), ring_.vertices.end(), to);
        if (at == ring_.vertices.end() || ring_.vertices.size() > FanOverlay::kMostCorners) {
            return false;
        }
        place_ = static_cast<std::size_t>(at - ring_.vertices.begin());
        const unsigned faces = faces_of(from);
        return (faces & ~faces_of(to)) == 0 && mesh_.keeps_topology(ring_, place_, locked_) &&
               look(faces) && has_no_new_needle() && has_no_new_fold() &&
               overlay_.displaced({before_.data(), star_.corners}, limit_, after_);
    }

    /// Turns the ring so that it begins with the vertex that the middle becomes.
    bool look(unsigned faces) {
        const std::size_t n = ring_.vertices.size();
        star_.corners = n;
        star_.missing = FanOverlay::kNone;
        if (!ring_.is_closed) {
            const unsigned common =
                faces & faces_of(ring_.vertices.front()) & faces_of(ring_.vertices.back());
            if (std::popcount(common) != 1) {
                return false;
            }
            star_.axis = static_cast<std::size_t>(std::countr_zero(common)) / 2;
            star_.missing = place_ == 0 ? n - 1 : 0;
        }
        const Double3 middle = point(ring_.middle);
        for (std::size_t i = 0; i < n; ++i) {
            const std::size_t k = place_ + i < n ? place_ + i : place_ + i - n;
            star_.ring[i] = minus(point(ring_.vertices[k]), middle);
            half_[i] = k < ring_.halves.size() ? ring_.halves[k] : kNone;
            before_[i] = half_[i] != kNone ? &patch_.displacements[half_[i] / 3] : nullptr;
        }
        return overlay_.look_at(star_);
    }

    /// Twice the area over the square of the longest edge: the sine of the smallest angle, nearly.
    static float thickness(const Double3& a, const Double3& b, const Double3& c) {
        const Double3 ab = minus(b, a);
        const Double3 ac = minus(c, a);
        const double longest = std::max({square(ab), square(ac), square(minus(c, b))});
        return longest > 0 ? static_cast<float>(length(cross(ab, ac)) / longest) : 0;
    }

    /// Whether no triangle is thin that is thinner than those before.
    [[nodiscard]] bool has_no_new_needle() const {
        const std::size_t n = star_.corners;
        const auto& p = star_.ring;
        float after = 1;
        for (std::size_t j = 1; j + 1 < n; ++j) {
            after = std::min(after, thickness(p[0], p[j], p[j + 1]));
        }
        if (after >= kThin) {
            return true;
        }
        float before = 1;
        for (std::size_t i = 0; i < n; ++i) {
            if (half_[i] != kNone) {
                before = std::min(before, thickness({0, 0, 0}, p[i], p[i + 1 < n ? i + 1 : 0]));
            }
        }
        return after >= before;
    }

    /// Makes the normals of the new triangles.
    bool has_no_new_fold() {
        const std::size_t n = star_.corners;
        float before = 1;
        float after = 1;
        const auto old = [&](std::size_t i) -> const Normal& { return normals_[half_[i] / 3]; };
        for (std::size_t j = 1; j + 1 < n; ++j) {
            turned_[j] = normal(star_.ring[0], star_.ring[j], star_.ring[j + 1]);
        }
        for (std::size_t i = 0; i < n; ++i) {
            if (half_[i] == kNone) {
                continue;
            }
            const std::size_t next = i + 1 < n ? i + 1 : 0;
            if (half_[next] != kNone) {
                before = std::min(before, cosine(old(i), old(next)));
            }
            const Normal& now = turned_[std::clamp<std::size_t>(i, 1, n - 2)];
            const std::uint32_t edge = CornerMesh::next(half_[i]);
            const std::uint32_t beyond = mesh_.across(edge);
            if (beyond != kNone) {
                const Normal& other = normals_[beyond / 3];
                before = std::min(before, cosine(old(i), other));
                after = std::min(after, cosine(now, other));
            } else if (patch_.shared[mesh_.start(edge)] && patch_.shared[mesh_.end(edge)]) {
                // What lies across may turn at the same time.
                return false;
            }
        }
        for (std::size_t j = 1; j + 2 < n; ++j) {
            after = std::min(after, cosine(turned_[j], turned_[j + 1]));
        }
        return after >= kFold || after >= before;
    }

    void take() {
        const std::size_t n = star_.corners;
        for (std::size_t j = 1; j + 1 < n; ++j) {
            const std::uint32_t t = half_[j] / 3;
            normals_[t] = turned_[j];
            patch_.displacements[t] = after_[j];
        }
        const std::uint32_t to = ring_.vertices[place_];
        mesh_.collapse(ring_, place_);
        mesh_.ring_of(to, ring_);
    }

    void write_back() {
        std::size_t left = 0;
        for (std::uint32_t t = 0; t < patch_.triangles.size(); ++t) {
            if (!mesh_.is_gone(t)) {
                const PatchTriangle c = mesh_.corners(t);
                patch_.triangles[left] = from_smallest(c);
                patch_.displacements[left] = patch_.displacements[t];
                patch_.tried[left] =
                    std::none_of(c.begin(), c.end(), [&](std::uint32_t v) { return locked_[v]; });
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
    std::vector<Normal> normals_;
    // The collapse that is looked at.
    CornerMesh::Ring ring_;
    std::size_t place_ = 0;  ///< in the ring, of what the middle becomes
    FanOverlay overlay_;
    FanOverlay::Star star_;
    std::array<std::uint32_t, FanOverlay::kMostCorners> half_{};  ///< from the middle
    std::array<const Displacement*, FanOverlay::kMostCorners> before_{};
    std::array<Displacement, FanOverlay::kMostCorners> after_{};
    std::array<Normal, FanOverlay::kMostCorners> turned_{};  ///< normals of the new triangles
};

}  // namespace

MappingResult map_patch(MappedPatch& patch, const MappingLimits& limits) {
    return patch.triangles.empty() ? MappingResult{} : PatchMapper(patch, limits).run();
}

}  // namespace isonest::detail
