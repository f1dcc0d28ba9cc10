// First a part of the mesh is searched, at a small fraction of the cost, so that the whole mesh is
// simplified for few limits, usually one.

#include "query/simplify/triangle_budget.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace isonest::detail {
namespace {

constexpr int kMaxSteps = 11;
/// A step with a larger fraction of the previous step's triangles is the last one.
constexpr double kHardlyFewer = 0.97;

}  // namespace

std::vector<LadderStep> distance_ladder(MeshSimplifier& simplifier, const ScratchMesh& mesh,
                                        double voxel, double moved, const ScratchFolder& folder,
                                        Progress& progress) {
    std::vector<LadderStep> ladder;
    Simplified last = simplifier.full();
    for (int i = 0; i < kMaxSteps; ++i) {
        const double distance = voxel * kFirstLadderStep * std::exp2(i / 2.0);
        const Simplified next = simplifier.within(last, distance - moved);
        const CornerFile corners = simplifier.corners(next);
        ladder.push_back(
            {std::make_unique<ScratchMesh>(folder, CornerFile::Bits::all), next.bound});
        emit_elements(mesh, corners.all(), folder, *ladder.back().mesh, progress);
        if (static_cast<double>(next.triangles) >=
            kHardlyFewer * static_cast<double>(last.triangles)) {
            break;
        }
        last = next;
    }
    return ladder;
}

namespace {

/// A mesh with at least this fraction of the requested triangles is good enough.
constexpr double kNearlyAll = 0.9;
constexpr double kAim = 0.96;
constexpr int kMaxTries = 4;  ///< after the first limit that is large enough
/// Minimum distance of a guess from both ends, as a fraction of the interval.
constexpr double kInside = 0.1;
constexpr std::uint64_t kSample = std::uint64_t{1} << 17U;  ///< full triangles

/// The limit expected to leave `aim` triangles, if limits `a` and `b` leave more and fewer.
double between(double a, double at_a, double b, double at_b, double aim) {
    const double share = std::log(at_a / aim) / std::log(at_a / at_b);
    return a * std::pow(b / a, std::clamp(share, kInside, 1 - kInside));
}

/// Searches from `full`, starting with the limit `first`.
Simplified search(MeshSimplifier& simplifier, const Simplified& full, std::uint64_t triangles,
                  double first, double most) {
    Simplified below = full;
    const auto is_met = [&](const Simplified& s) { return s.triangles <= triangles; };
    if (is_met(below)) {
        return below;
    }
    std::optional<Simplified> enough;
    const auto asked = static_cast<double>(triangles);
    const auto is_near = [&](const Simplified& s) {
        return static_cast<double>(s.triangles) >= kNearlyAll * asked;
    };
    // Increase the limit until there are few enough triangles.
    for (double limit = std::min(first, most); !enough;) {
        const Simplified next = simplifier.within(below, limit);
        if (is_met(next)) {
            enough = next;
            break;
        }
        // For most scans the number of triangles is inversely proportional to the distance, or
        // larger.
        const double factor =
            std::clamp(static_cast<double>(next.triangles) / (kAim * asked), 1.02, 4.0);
        below = next;
        if (limit >= most) {
            return below;
        }
        limit = std::min(limit * factor, most);
    }
    // Interpolate, assuming that the number of triangles is a power of the distance.
    for (int i = 0; i < kMaxTries && !is_near(*enough); ++i) {
        const double low = std::max(below.limit, first / 16);
        const double limit = between(low, static_cast<double>(below.triangles), enough->limit,
                                     static_cast<double>(enough->triangles), kAim * asked);
        if (!(limit > low) || !(limit < enough->limit)) {
            break;
        }
        const Simplified next = simplifier.within(below, limit);
        (is_met(next) ? *enough : below) = next;
    }
    return *enough;
}

}  // namespace

Simplified within_budget(MeshSimplifier& simplifier, std::uint64_t triangles, double first,
                         double most) {
    const Simplified full = simplifier.full();
    const Simplified sample = simplifier.sample(kSample);
    if (full.triangles <= triangles || sample.triangles == 0 ||
        sample.triangles == full.triangles) {
        return search(simplifier, full, triangles, first, most);
    }
    const double share =
        static_cast<double>(sample.triangles) / static_cast<double>(full.triangles);
    const auto of_sample = static_cast<std::uint64_t>(share * static_cast<double>(triangles));
    const Simplified found = search(simplifier, sample, of_sample, first, most);
    return search(simplifier, full, triangles, std::max(found.limit, first / 16), most);
}

}  // namespace isonest::detail
