#include "query/apart/parts_apart.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <vector>

#include "query/apart/placed_vertices.h"
#include "query/apart/touched_triangles.h"

namespace isonest::detail {
namespace {

constexpr auto kPrecedesByNumber = [](const PlacedVertex& a, const PlacedVertex& b) {
    return a.number < b.number;
};

}  // namespace

TouchedInPart touched_in(const PartStore& parts, const PartRecord& r, const VertexNumbers& weld,
                         const std::function<bool(std::uint64_t)>& touches) {
    TouchedInPart found;
    if (r.not_alone == 0) {
        return found;
    }
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    weld.numbers(r, number, owned);
    std::vector<bool> touched(r.vertices);
    bool any = false;
    for (const std::uint32_t v : parts.not_alone(r)) {
        touched[v] = touches(number[v]);
        any = any || touched[v];
    }
    if (!any) {
        return found;
    }
    const auto positions = parts.vertices(r);
    for (const auto& t : parts.triangles(r)) {
        if (touched[t[0]] || touched[t[1]] || touched[t[2]]) {
            found.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
            found.at.push_back({positions[t[0]], positions[t[1]], positions[t[2]]});
        }
    }
    return found;
}

void put_back(PartStore& parts, const VertexNumbers& weld, std::span<PlacedVertex> vertices) {
    tbb::parallel_sort(vertices.begin(), vertices.end(), kPrecedesByNumber);
    const auto records = parts.records();
    tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        const PartRecord& r = records[i];
        if (r.not_alone == 0) {
            return;
        }
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        weld.numbers(r, number, owned);
        const auto positions = parts.changeable_vertices(r);
        for (const std::uint32_t v : parts.not_alone(r)) {
            PlacedVertex sought;
            sought.number = number[v];
            const auto found =
                std::lower_bound(vertices.begin(), vertices.end(), sought, kPrecedesByNumber);
            if (found != vertices.end() && found->number == number[v] &&
                found->now != found->start) {
                positions[v] = found->now;
            }
        }
    });
}

ApartVertices keep_parts_apart(PartStore& parts, const VertexNumbers& weld, ApartRange range,
                               const ScratchFolder& folder, Progress& progress) {
    const PlacedVertices placed(parts, weld, range.turn, folder, progress);
    if (sort_by_place(placed.all()) == 0) {
        return {};
    }
    ScratchFile position_file(folder);
    position_file.map(weld.vertices() * sizeof(std::array<float, 3>));
    const auto positions = position_file.as<std::array<float, 3>>();
    TouchedTriangles touched(placed.all(), weld.vertices(), folder);
    touched.gather(
        parts.records().size(),
        [&](std::size_t i) {
            progress.check();
            return touched_in(parts, parts.records()[i], weld,
                              [&](std::uint64_t v) { return touched.touches(v); });
        },
        [&](const TouchedInPart& some) {
            for (std::size_t t = 0; t < some.triangles.size(); ++t) {
                for (std::size_t i = 0; i < 3; ++i) {
                    positions[some.triangles[t][i]] = some.at[t][i];
                }
            }
        });
    range.lo = parts.lo();
    range.hi = parts.hi();
    const ApartVertices apart =
        keep_apart(positions, touched.all(), placed.all(), range, folder, progress);
    if (apart.moved > 0) {
        put_back(parts, weld, placed.all());
    }
    return apart;
}

}  // namespace isonest::detail
