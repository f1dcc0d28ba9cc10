#include "query/slabs/slab_part.h"

#include <algorithm>
#include <bit>
#include <utility>
#include <vector>

namespace isonest::detail {

MeshPart part_of(MarchedSlab&& slab) {
    const bool normals = !slab.normals.empty();
    MeshPart part;
    std::vector<std::uint32_t> number(slab.positions.size(), MeshPart::kNoVertex);
    part.world.reserve(slab.positions.size());
    part.attributes.reserve(normals ? 3 * slab.positions.size() : 0);
    for (auto& triangle : slab.triangles) {
        for (std::uint32_t& v : triangle) {
            if (number[v] == MeshPart::kNoVertex) {
                number[v] = static_cast<std::uint32_t>(part.world.size());
                part.world.push_back(slab.positions[v]);
                for (std::size_t i = 0; normals && i < 3; ++i) {
                    part.attributes.push_back(std::bit_cast<std::uint32_t>(slab.normals[v][i]));
                }
            }
            v = number[v];
        }
    }
    part.triangles = std::exchange(slab.triangles, {});
    for (const std::uint32_t v : slab.not_alone) {
        if (number[v] != MeshPart::kNoVertex) {
            part.off_edges.push_back(number[v]);
        }
    }
    std::sort(part.off_edges.begin(), part.off_edges.end());

    // Those with a vertex come first, in ascending order of it; a vertex may have several names.
    std::vector<std::uint32_t> named;
    for (const MarchedSlab::Named& n : slab.shared) {
        named.push_back(n.vertex);
    }
    const auto by_number = [&](std::uint32_t v) { return std::pair(number[v], v); };
    std::sort(named.begin(), named.end(),
              [&](std::uint32_t a, std::uint32_t b) { return by_number(a) < by_number(b); });
    named.erase(std::unique(named.begin(), named.end()), named.end());
    part.shared.reserve(named.size());
    for (const std::uint32_t v : named) {
        part.shared.push_back({number[v]});
    }
    part.names.reserve(slab.shared.size());
    for (const MarchedSlab::Named& n : slab.shared) {
        const auto place = std::lower_bound(
            named.begin(), named.end(), n.vertex,
            [&](std::uint32_t a, std::uint32_t b) { return by_number(a) < by_number(b); });
        part.names.push_back({n.key, static_cast<std::uint32_t>(place - named.begin())});
    }
    return part;
}

}  // namespace isonest::detail
