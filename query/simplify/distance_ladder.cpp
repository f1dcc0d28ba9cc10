#include "query/simplify/distance_ladder.h"

#include <cmath>

namespace isonest::detail {
namespace {

constexpr int kMostSteps = 11;
/// A step with a larger share of the triangles before it is the last one.
constexpr double kHardlyFewer = 0.97;

}  // namespace

std::vector<LadderStep> distance_ladder(MeshSimplifier& simplifier, const ScratchMesh& mesh,
                                        double voxel, double moved, const ScratchFolder& folder,
                                        Progress& progress) {
    std::vector<LadderStep> ladder;
    Simplified last = simplifier.full();
    for (int i = 0; i < kMostSteps; ++i) {
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

}  // namespace isonest::detail
