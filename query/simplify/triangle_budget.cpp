// A part of the mesh is searched first, which costs a small share of what the mesh does: so that
// the whole is simplified within few limits, most often one.
#include "query/simplify/triangle_budget.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace isonest::detail {
namespace {

/// A mesh with this share of the triangles asked for is near enough.
constexpr double kNearlyAll = 0.9;
constexpr double kAim = 0.96;
constexpr int kMostTries = 4;  ///< after the first limit that is large enough
/// A guess stays so far from both ends, in shares of what lies between them.
constexpr double kInside = 0.1;
constexpr std::uint64_t kSample = std::uint64_t{1} << 17U;  ///< full triangles

/// The limit that leaves `aim` triangles, of which limits `a` and `b` leave more and fewer.
double between(double a, double at_a, double b, double at_b, double aim) {
    const double share = std::log(at_a / aim) / std::log(at_a / at_b);
    return a * std::pow(b / a, std::clamp(share, kInside, 1 - kInside));
}

/// From `full`, for the first time within `first`.
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
    // From limits that leave too many to one that does not.
    for (double limit = std::min(first, most); !enough;) {
        const Simplified next = simplifier.within(below, limit);
        if (is_met(next)) {
            enough = next;
            break;
        }
        // The surface of most scans has triangles in inverse proportion to the distance, or more.
        const double factor =
            std::clamp(static_cast<double>(next.triangles) / (kAim * asked), 1.02, 4.0);
        below = next;
        if (limit >= most) {
            return below;
        }
        limit = std::min(limit * factor, most);
    }
    // Between the two, as if the triangles went with a power of the distance.
    for (int i = 0; i < kMostTries && !is_near(*enough); ++i) {
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
