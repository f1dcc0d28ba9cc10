#include "query/apart/placed_vertices.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <vector>

namespace isonest::detail {
namespace {

/// Of a vertex that an earlier part has as well.
constexpr std::uint64_t kOfOther = std::numeric_limits<std::uint64_t>::max();

}  // namespace

PlacedVertices::PlacedVertices(const PartStore& parts, const VertexNumbers& weld,
                               const std::optional<Turn>& turn, const ScratchFolder& folder,
                               Progress& progress)
    : file_(folder) {
    const auto records = parts.records();
    if (!records.empty()) {
        count_ = records.back().first_not_alone + records.back().not_alone;
    }
    if (count_ == 0) {
        return;
    }
    file_.map(count_ * sizeof(PlacedVertex));
    const auto all = this->all();
    tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        const PartRecord& r = records[i];
        if (r.not_alone == 0) {
            return;
        }
        progress.check();
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        weld.numbers(r, number, owned);
        const auto positions = parts.vertices(r);
        std::uint64_t at = r.first_not_alone;
        for (const std::uint32_t v : parts.not_alone(r)) {
            all[at++] = placed_vertex(owned[v] ? number[v] : kOfOther, positions[v], turn);
        }
    });
    const auto end = std::remove_if(all.begin(), all.end(),
                                    [](const PlacedVertex& v) { return v.number == kOfOther; });
    count_ = static_cast<std::uint64_t>(end - all.begin());
}

PlacedVertices::PlacedVertices(std::span<const std::array<float, 3>> positions,
                               std::span<const std::uint32_t> numbers, const ScratchFolder& folder)
    : file_(folder), count_(numbers.size()) {
    file_.map(count_ * sizeof(PlacedVertex));
    std::transform(numbers.begin(), numbers.end(), all().begin(),
                   [&](std::uint32_t v) { return placed_vertex(v, positions[v]); });
}

PlacedVertices::PlacedVertices(const ScratchMesh& mesh, const std::optional<Turn>& turn,
                               const ScratchFolder& folder)
    : file_(folder), count_(mesh.positions().size()) {
    file_.map(count_ * sizeof(PlacedVertex));
    const auto all = this->all();
    for (std::uint64_t v = 0; v < count_; ++v) {
        all[v] = placed_vertex(v, mesh.positions()[v], turn);
    }
}

}  // namespace isonest::detail
