// Around a vertex without a border every neighbour is as often the first as the second of a
// triangle's other two corners, so that a sum of their mixed numbers, with signs, is 0. At a border
// it is a difference of at least two, which is 0 with a probability of 2^-64.
#include "query/mesh/border_count.h"

#include <algorithm>

namespace isonest::detail {
BorderCount::BorderCount(std::uint64_t vertices, const ScratchFolder& folder) : file_(folder) {
    file_.map(vertices * sizeof(std::uint64_t));
    balance_ = file_.as<std::uint64_t>();
}

void BorderCount::add(const ElementCorners& triangle) {
    for (std::size_t i = 0; i < 3; ++i) {
        balance_[triangle[i]] += mixed(triangle[(i + 1) % 3]) - mixed(triangle[(i + 2) % 3]);
    }
}

std::uint64_t BorderCount::vertices() const {
    return static_cast<std::uint64_t>(std::count_if(
        balance_.begin(), balance_.end(), [](std::uint64_t balance) { return balance != 0; }));
}

std::uint64_t border_vertices(const PartStore& parts, const VertexNumbers& weld,
                              const ScratchFolder& folder, Progress& progress) {
    progress.begin("count borders", weld.triangles(), "triangles");
    BorderCount count(weld.vertices(), folder);
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    for (const PartRecord& r : parts.records()) {
        progress.check();
        weld.numbers(r, number, owned);
        for (const auto& t : parts.triangles(r)) {
            count.add({number[t[0]], number[t[1]], number[t[2]]});
        }
        progress.advance(r.triangles);
    }
    return count.vertices();
}

std::uint64_t border_vertices(const ScratchMesh& mesh, const CornerView& triangles,
                              const ScratchFolder& folder, Progress& progress) {
    constexpr std::size_t kOften = std::size_t{1} << 16U;
    progress.begin("count borders", triangles.size(), "triangles");
    BorderCount count(mesh.layout().vertices, folder);
    for (std::size_t at = 0; at < triangles.size(); at += kOften) {
        progress.check();
        const auto some = triangles.subspan(at, std::min(kOften, triangles.size() - at));
        for (const ElementCorners t : some) {
            count.add(t);
        }
        progress.advance(some.size());
    }
    return count.vertices();
}

}  // namespace isonest::detail
