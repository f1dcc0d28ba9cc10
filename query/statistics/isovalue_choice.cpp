#include "query/statistics/isovalue_choice.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace isonest::detail {
namespace {

constexpr std::uint64_t kFewestNodes = 64;
constexpr std::uint64_t kLeastNodes = 65536;  ///< one of so many
constexpr std::uint64_t kLeastSurface = 100;  ///< one of so many
constexpr std::size_t kWindow = 32;           ///< one of so many
constexpr double kProminence = 1.5;
constexpr std::size_t kMostSuggested = 5;

/// Some neighbouring bins.
struct Group {
    std::size_t middle = 0;  ///< the bin at whose smallest value the isovalue is
    double nodes = 0;
    double cubes = 0;
};

/// How many times the lowest point on the way to a higher one the curve is at i, the less of both
/// directions; infinite if none is higher. Of equal heights the first counts as the higher one.
double prominence(const std::vector<double>& curve, std::size_t i) {
    double least = std::numeric_limits<double>::infinity();
    double valley = curve[i];
    for (std::size_t j = i; j-- > 0;) {
        if (curve[j] >= curve[i]) {
            least = curve[i] / valley;
            break;
        }
        valley = std::min(valley, curve[j]);
    }
    valley = curve[i];
    for (std::size_t j = i + 1; j < curve.size(); ++j) {
        if (curve[j] > curve[i]) {
            return std::min(least, curve[i] / valley);
        }
        valley = std::min(valley, curve[j]);
    }
    return least;
}

std::vector<Group> groups_of(std::span<const std::uint64_t> nodes,
                             std::span<const std::uint64_t> cubes) {
    const std::uint64_t all = std::accumulate(nodes.begin(), nodes.end(), std::uint64_t{0});
    const std::uint64_t largest = *std::max_element(cubes.begin(), cubes.end());
    const std::uint64_t enough = std::max(kFewestNodes, all / kLeastNodes);
    std::vector<Group> groups;
    for (std::size_t begin = 0; begin < nodes.size();) {
        std::uint64_t sum = 0;
        std::size_t end = begin;
        while (end < nodes.size() && sum < enough) {
            sum += nodes[end++];
        }
        if (sum < enough) {
            break;  // too few are left
        }
        Group group;
        group.middle = std::clamp<std::size_t>((begin + end) / 2, 1, nodes.size() - 1);
        group.nodes = static_cast<double>(sum);
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint64_t above = k + 1 < cubes.size() ? cubes[k + 1] : 0;
            group.cubes += (static_cast<double>(cubes[k]) + static_cast<double>(above)) / 2;
        }
        if (cubes[group.middle] >= largest / kLeastSurface && cubes[group.middle] > 0) {
            groups.push_back(group);
        }
        begin = end;
    }
    return groups;
}

}  // namespace

std::vector<SuggestedIsovalue> suggest_isovalues(const ValueBins& bins,
                                                 std::span<const std::uint64_t> nodes,
                                                 std::span<const std::uint64_t> cubes) {
    if (bins.count() < 2) {
        return {};
    }
    const std::vector<Group> groups = groups_of(nodes, cubes);
    const std::size_t reach = groups.size() / kWindow;
    std::vector<double> curve;
    for (std::size_t i = 0; i < groups.size(); ++i) {
        Group sum;
        for (std::size_t j = i - std::min(i, reach); j < std::min(i + reach + 1, groups.size());
             ++j) {
            sum.nodes += groups[j].nodes;
            sum.cubes += groups[j].cubes;
        }
        curve.push_back(sum.cubes / sum.nodes);
    }
    struct Peak {
        double prominence;
        std::size_t middle;
    };
    std::vector<Peak> peaks;
    for (std::size_t i = 0; i < groups.size(); ++i) {
        const double height = prominence(curve, i);
        if (height >= kProminence) {
            peaks.push_back({height, groups[i].middle});
        }
    }
    std::stable_sort(peaks.begin(), peaks.end(),
                     [](const Peak& a, const Peak& b) { return a.prominence > b.prominence; });
    peaks.resize(std::min(peaks.size(), kMostSuggested));
    std::vector<SuggestedIsovalue> suggested;
    suggested.reserve(peaks.size());
    for (const Peak& peak : peaks) {
        // No integer lies between: the same cubes, and the surface passes through no node.
        suggested.push_back({bins.low[peak.middle] - (bins.integer ? 0.5 : 0), cubes[peak.middle]});
    }
    return suggested;
}

}  // namespace isonest::detail
