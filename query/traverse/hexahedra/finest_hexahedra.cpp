#include "query/traverse/hexahedra/finest_hexahedra.h"

#include <cmath>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/bricks/cube_nodes.h"

namespace isonest::detail {
namespace {

class FinestHexahedra {
  public:
    FinestHexahedra(TraversalRun& run, const Int3& brick)
        : query_(run.query),
          base_(brick * run.layout().header().chunk),
          values_(run.cache, 0, base_),
          parts_(run, 0, base_),
          counts_(run.counts.local()) {}

    void march(const MaskList& cubes) {
        parts_.for_each_parent(cubes, 0, [&](const Int3& parent, std::uint8_t /*all*/) {
            const Overlap overlap =
                overlap_of(query_.box, parent * 2, (parent + Int3{1, 1, 1}) * 2);
            if (overlap != Overlap::outside) {
                refine(parent, overlap == Overlap::crossing);
            }
        });
    }

  private:
    void refine(const Int3& parent, bool cut) {
        values_.load(nodes_, parent, 0);
        const Sides sides = sides_of(nodes_.value, query_.iso);
        // What is beyond a closed box's face counts.
        const Sides here = cut && query_.box.close ? sides.with(*query_.box.close) : sides;
        const std::uint32_t special = special_nodes(nodes_.value, query_.iso);
        for (unsigned corner = 0; corner < 8; ++corner) {
            const std::uint32_t corners = topology_.corners[corner];
            if (!here.both_in(corners)) {
                continue;
            }
            bool cell_cut = cut;
            if (cut) {
                const Int3 cell = nodes_.subcube(corner);
                const Overlap overlap = overlap_of(query_.box, cell, cell + Int3{1, 1, 1});
                if (overlap == Overlap::outside) {
                    continue;
                }
                cell_cut = overlap == Overlap::crossing;
                if (!cell_cut && !sides.both_in(corners)) {
                    continue;
                }
            }
            march_cell(corner, sides, (special & corners) != 0, cell_cut);
        }
    }
    void march_cell(unsigned corner, const Sides& sides, bool special, bool cut) {
        ++counts_.visited;
        Cube cube{nodes_.subcube(corner), 0, 0, {}};
        bool missing = false;
        for (unsigned i = 0; i < 8; ++i) {
            const unsigned at = interest::kCorners[corner][i];
            cube.value[i] = nodes_.value[at];
            cube.below |= ((sides.below >> at) & 1U) << i;
            missing = missing || (special && !std::isfinite(cube.value[i]));
        }
        if (!missing) {
            counts_.leaves +=
                parts_.mesh().march_hexahedron(cube, special, query_.iso, cut) ? 1 : 0;
        }
    }

    const TraversalQuery& query_;
    Int3 base_;
    const Topology& topology_ = topology();
    CubeLoader values_;
    BrickParts parts_;
    TraversalCounts& counts_;
    CubeNodes nodes_;
};

}  // namespace

void march_finest_hexahedra(TraversalRun& run, const Int3& brick, const MaskList& cubes) {
    FinestHexahedra(run, brick).march(cubes);
}

}  // namespace isonest::detail
