#include "query/slabs/slab_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "query/mesh/coordinate_rounding.h"
#include "query/slabs/march_slab.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/extent.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kMostLayers = 16;  ///< of a slab
/// Vertices of a slab have three quarters of the 32-bit numbers at most.
constexpr std::int64_t kMostNodes = std::int64_t{1} << 29U;

/// What slabs of so many layers need.
struct SlabNeeds {
    std::uint64_t all;   ///< bytes in any case
    std::uint64_t each;  ///< bytes of one that is worked on
};
SlabNeeds needs_of(const SlabReader& reader, const Int3& nodes, std::int64_t layers,
                   std::uint64_t each_more) {
    return {kLibraryHeap + reader.own_bytes(layers),
            reader.slab_bytes(layers) + march_slab_bytes(nodes) + each_more};
}

}  // namespace

bool is_marchable(const VolumeDescription& volume) {
    const Int3& n = volume.nodes;
    return !volume.labels && std::min({n.x, n.y, n.z}) > 1 && n.x * n.y <= kMostNodes / 2;
}

void require_marchable(const VolumeDescription& volume, double iso) {
    const Int3& n = volume.nodes;
    if (!std::isfinite(iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", iso));
    }
    if (const std::string why = why_no_place(n, volume.spacing, volume.origin); !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why,
                    {{RemedyKind::place_in_world, "spacing,origin"}});
    }
    if (std::min({n.x, n.y, n.z}) < 2) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    fmt::format("{} x {} x {} nodes have no cells", n.x, n.y, n.z));
    }
    if (volume.labels) {
        throw Error(ErrorKind::unsupported, {volume.name},
                    "its values are labels of 64 bits, of which a store knows the surfaces",
                    {{RemedyKind::make_store}});
    }
    for (int axis = 0; axis < 3; ++axis) {
        const double most = largest_coordinate(n, volume.spacing, volume.origin, axis);
        if (!(most <= static_cast<double>(std::numeric_limits<float>::max()))) {
            throw Error(ErrorKind::limit, {volume.name},
                        fmt::format("the volume reaches {} = {:.6g}, and a mesh's 32-bit floats "
                                    "end before",
                                    "xyz"[axis], most),
                        {{RemedyKind::place_in_world, "spacing,origin"}});
        }
    }
    if (n.x * n.y > kMostNodes / 2) {
        throw Error(ErrorKind::limit, {volume.name},
                    "a layer of cells can have more vertices than 32 bits can number");
    }
}

std::uint64_t least_slab_memory(const SlabReader& reader, const VolumeDescription& volume,
                                std::uint64_t each_more) {
    const SlabNeeds needs = needs_of(reader, volume.nodes, 1, each_more);
    return needs.all + needs.each;
}

SlabPlan slab_plan(const SlabReader& reader, const VolumeDescription& volume,
                   const ExtractOptions& options, std::uint64_t each_more) {
    const Int3& n = volume.nodes;
    require_memory(volume.name, options.memory, least_slab_memory(reader, volume, each_more),
                   "planes of this volume");
    SlabPlan plan;
    plan.threads = Workers::count_of(options.threads);
    const auto needed = [&](std::int64_t layers, int slabs) {
        const SlabNeeds needs = needs_of(reader, n, layers, each_more);
        return needs.all + static_cast<std::uint64_t>(slabs) * needs.each;
    };
    const auto fits = [&](std::int64_t layers, int slabs) {
        return needed(layers, slabs) <= options.memory;
    };
    // Several slabs for each thread, so that all have work until the end.
    plan.layers = std::clamp<std::int64_t>((n.z - 1) / (4 * plan.threads), 2, kMostLayers);
    plan.layers = std::clamp<std::int64_t>(kMostNodes / (n.x * n.y), 1, plan.layers);
    while (plan.layers > 1 && !fits(plan.layers, plan.threads)) {
        plan.layers /= 2;
    }
    while (plan.threads > 1 && !fits(plan.layers, plan.threads)) {
        --plan.threads;
    }
    plan.slabs_at_once = fits(plan.layers, plan.threads + 1) ? plan.threads + 1 : plan.threads;
    plan.spare = options.memory - needed(plan.layers, plan.slabs_at_once);
    return plan;
}

}  // namespace isonest::detail
