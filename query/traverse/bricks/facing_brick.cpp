#include "query/traverse/bricks/facing_brick.h"

#include <algorithm>
#include <vector>

#include "query/traverse/bricks/brick_interest.h"

namespace isonest::detail {
namespace {

constexpr int kLevel = 3;
constexpr std::int64_t kEdge = std::int64_t{1} << kLevel;

/// Values and bounds of the cubes in one brick of level 3.
class CoarseCubes {
  public:
    CoarseCubes(TraversalRun& run, const Int3& brick)
        : culling_(*run.query.culling),
          at_(run.layout(), kLevel, brick),
          values_(run.cache, kLevel, at_.base),
          bound_(field_view(run, culling_.field(), at_)),
          counts_(run.counts.local()) {}

    /// Whether the six tetrahedra of the cube face away, as they are.
    [[nodiscard]] bool face_away(const Int3& cube) { return all_face_away(cube, 0); }
    /// Whether all that is below them does.
    [[nodiscard]] bool all_below_face_away(const Int3& cube) {
        return all_face_away(cube, bound_.centre(cube));
    }

  private:
    [[nodiscard]] bool all_face_away(const Int3& cube, double beta) {
        CubeNodes nodes;
        values_.load(nodes, {cube.x / 2, cube.y / 2, cube.z / 2});
        const auto& tetrahedra = topology().subcube[mirror_of(cube) ^ nodes.mirror];
        return std::all_of(tetrahedra.begin(), tetrahedra.end(), [&](const auto& t) {
            ++counts_.visited;
            return culling_.faces_away(nodes.value, t, nodes.mirror, at_.stride, beta);
        });
    }

    const Culling& culling_;
    BrickPlace at_;
    CubeLoader values_;
    FieldView bound_;
    TraversalCounts& counts_;
};

/// The brick's cubes of level 3 that may hold some of the surface.
std::vector<Int3> surface_cubes_of(const TraversalRun& run, const Int3& brick) {
    const StoreLayout& layout = run.layout();
    const std::int64_t edge = layout.header().chunk / kEdge;
    const Int3 first = brick * edge;
    const Int3 size = min(Int3{edge, edge, edge}, layout.lattice().cells_at(kLevel) - first);
    std::vector<Int3> cubes;
    for (std::int64_t i = 0; i < size.product(); ++i) {
        const Int3 cube = first + size.unlinear(i);
        const auto range = layout.has_cube_ranges(kLevel)
                               ? run.cache.source().cube_range(kLevel, cube)
                               : std::nullopt;
        if (!range || range->may_hold(run.query.iso)) {
            cubes.push_back(cube);
        }
    }
    return cubes;
}

}  // namespace

bool may_face_viewer(TraversalRun& run, const Int3& brick) {
    if (run.layout().lattice().top() < kLevel) {
        return true;
    }
    const std::vector<Int3> surface = surface_cubes_of(run, brick);
    CoarseCubes cubes(run, {brick.x / kEdge, brick.y / kEdge, brick.z / kEdge});
    return !std::all_of(surface.begin(), surface.end(),
                        [&](const Int3& cube) { return cubes.face_away(cube); }) ||
           !std::all_of(surface.begin(), surface.end(),
                        [&](const Int3& cube) { return cubes.all_below_face_away(cube); });
}

void add_facing_needs(const TraversalRun& run, const Int3& brick, ChunkNeeds& needs) {
    const StoreLayout& layout = run.layout();
    if (layout.lattice().top() < kLevel) {
        return;
    }
    const std::int64_t chunk = layout.header().chunk;
    const std::int64_t edge = chunk / kEdge;
    const Int3 first = brick * edge;
    const ArrayInfo& values = layout.array(kLevel, Field::values);
    const ArrayInfo& bounds = layout.array(kLevel, run.query.culling->field());
    // A cube lies in a parent of even coordinates, whose nodes are asked for.
    const Int3 end = first + Int3{edge, edge, edge};
    const Int3 last = min({end.x + end.x % 2, end.y + end.y % 2, end.z + end.z % 2},
                          values.nodes - Int3{1, 1, 1});
    const Int3 low = values.chunk_of(first);
    const Int3 size = values.chunk_of(last) - low + Int3{1, 1, 1};
    for (std::int64_t i = 0; i < size.product(); ++i) {
        needs.add(values, low + size.unlinear(i), i == 0);
    }
    needs.add(bounds, bounds.chunk_of(first));
}

}  // namespace isonest::detail
