#include "query/simplify/collapse.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <limits>

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

}  // namespace

std::vector<PatchTriangle> collapse_edges(const Patch& patch,
                                          std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& locked, double error) {
    // Vertices without triangles would count in meshoptimizer's scale and in its time.
    std::vector<std::uint32_t> number(patch.positions.size(), kNone);
    std::vector<std::uint32_t> vertex;
    std::vector<std::array<float, 3>> positions;
    std::vector<std::uint32_t> indices;
    indices.reserve(3 * triangles.size());
    std::array<float, 3> lo = patch.positions[triangles.front()[0]];
    std::array<float, 3> hi = lo;
    for (const PatchTriangle& t : triangles) {
        for (const std::uint32_t v : t) {
            if (number[v] == kNone) {
                number[v] = static_cast<std::uint32_t>(vertex.size());
                vertex.push_back(v);
                positions.push_back(patch.positions[v]);
                for (std::size_t a = 0; a < 3; ++a) {
                    lo[a] = std::min(lo[a], patch.positions[v][a]);
                    hi[a] = std::max(hi[a], patch.positions[v][a]);
                }
            }
            indices.push_back(number[v]);
        }
    }
    // It leaves a vertex alone that has several border edges: so each locked one gets two fins,
    // whose other corners are two vertices more.
    const auto first = static_cast<std::uint32_t>(vertex.size());
    positions.push_back(lo);
    positions.push_back(hi);
    for (std::uint32_t v = 0; v < first; ++v) {
        if (locked[vertex[v]]) {
            indices.insert(indices.end(), {v, first, first + 1, v, first, first + 1});
        }
    }
    const float scale =
        meshopt_simplifyScale(positions.front().data(), positions.size(), sizeof(positions[0]));
    if (!(scale > 0)) {
        return {triangles.begin(), triangles.end()};
    }
    std::vector<std::uint32_t> left(indices.size());
    left.resize(meshopt_simplify(left.data(), indices.data(), indices.size(),
                                 positions.front().data(), positions.size(), sizeof(positions[0]),
                                 0, static_cast<float>(error) / scale, 0, nullptr));
    std::vector<PatchTriangle> result;
    for (std::size_t i = 0; i < left.size(); i += 3) {
        if (std::max({left[i], left[i + 1], left[i + 2]}) < first) {
            result.push_back({vertex[left[i]], vertex[left[i + 1]], vertex[left[i + 2]]});
        }
    }
    return result;
}

}  // namespace isonest::detail
