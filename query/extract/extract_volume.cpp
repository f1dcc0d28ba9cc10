// A surface straight from a volume into a sink, through the stages of an extraction:
//
//     volume -> planes of a slab   query/slabs/slab_reader.h
//     planes -> parts              query/slabs/march_slab.h, slab_part.h
//     parts  -> mesh in the sink   query/extract/extraction.h
//
// Nothing but files grows with the volume or the mesh.
#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>

#include <isonest/march.h>

#include "query/apart/keep_apart.h"
#include "query/extract/combinations.h"
#include "query/extract/extraction.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/rotated_sink.h"
#include "query/slabs/each_slab.h"
#include "query/slabs/slab_part.h"
#include "query/slabs/slab_plan.h"
#include "query/slabs/value_range.h"
#include "store/base/workers.h"
#include "store/container/extent.h"

namespace isonest {
namespace detail {
namespace {

/// Weights of parts.
constexpr std::size_t kLeastMarched = 4096;
constexpr std::size_t kMostMarched = 65536;

/// How the memory of a volume that is marched into parts is shared.
struct MarchBudget {
    SlabPlan plan;
    std::size_t part = kLeastMarched;  ///< weight at which parts end
    std::uint64_t parts = 0;           ///< bytes for those that are finished
};

/// Bytes of parts that a slab has at a time at least: they end with a row of cells.
std::uint64_t least_parts(const Int3& nodes) {
    return (kLeastMarched + 2 * static_cast<std::uint64_t>(nodes.x)) * kBytesPerPartWeight;
}

MarchBudget march_budget(const SlabReader& reader, const VolumeDescription& volume,
                         const ExtractOptions& options) {
    MarchBudget budget{slab_plan(reader, volume, options, least_parts(volume.nodes))};
    const auto slabs = static_cast<std::uint64_t>(budget.plan.slabs_at_once);
    std::uint64_t spare = budget.plan.spare;
    budget.part = std::clamp<std::size_t>(kLeastMarched + spare / 4 / slabs / kBytesPerPartWeight,
                                          kLeastMarched, kMostMarched);
    spare -= slabs * (budget.part - kLeastMarched) * kBytesPerPartWeight;
    budget.parts = spare / 2;
    return budget;
}

/// Fills the parts and seals them.
void march_into(const FoundParts& found, SlabReader& reader, const VolumeDescription& volume,
                const SlabPlace& place, const MarchBudget& budget, Progress& progress) {
    /// What is found in a slab.
    struct Found {
        ValueRange range;
        std::uint64_t cells = 0;
    };
    const Int3& nodes = volume.nodes;
    SlabMarchers marchers(volume.type, nodes, place);
    ValueRange range;
    each_slab<Found>(
        reader, nodes.z - 1, budget.plan, "extract", progress,
        [&](const Slab& layers, const SlabPlanes& planes) {
            Found here;
            here.range = range_of(volume.type, planes, nodes, layers.begin,
                                  layers.end + 1 == nodes.z ? nodes.z : layers.end);
            marchers.with_one([&](SlabMarcher& marcher) {
                marcher.march_parts(planes, layers, budget.part,
                                    [&](std::uint64_t order, MarchedSlab&& slab) {
                                        here.cells += slab.cells;
                                        found.parts->append(order, part_of(std::move(slab)));
                                    });
            });
            return here;
        },
        [&](const Found& here) {
            range.add(here.range);
            found.report->traversal.leaves += here.cells;
        });
    found.parts->seal();
    found.report->traversal.visited = found.report->traversal.leaves;
    found.report->value_range = std::max(range.high - range.low, 0.0);
}

/// In the volume's own axes.
ExtractReport extract_along_axes(VolumeSource& volume, const VolumeDescription& description,
                                 const SurfaceQuery& query, MeshSink& sink,
                                 const ExtractOptions& options, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    MeasuringSink measuring(sink, options.quality);
    ExtractQuery asked = extract_query(description, query);
    const SlabPlace place{query.iso, query.attributes.normals, description.spacing,
                          description.origin,
                          sight_apart(asked.coordinate_rounding, asked.least_apart)};
    Extraction extraction({description.name, header_of(description)}, std::move(asked), measuring,
                          options, progress);
    extraction.prepare(volume.files());
    SlabReader reader(volume);
    const MarchBudget budget = march_budget(reader, description, options);
    Workers(budget.plan.threads).execute([&] {
        march_into(extraction.begin_parts(budget.parts), reader, description, place, budget,
                   progress);
    });
    TraversalBudget traversal;
    traversal.threads = budget.plan.threads;
    ExtractReport report = extraction.finish(traversal);
    measuring.report(report);
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace
}  // namespace detail

ExtractReport extract(VolumeSource& volume, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    using namespace detail;
    const VolumeDescription description = volume.describe();
    if (description.direction == kAlongWorld) {
        return extract_along_axes(volume, description, query, sink, options, progress);
    }
    RotatedSink turning(sink, description.origin, description.direction);
    ExtractReport report =
        extract_along_axes(volume, description, query, turning, options, progress);
    report_turning(turning, description.spacing, report);
    return report;
}

std::optional<std::uint64_t> march_memory(VolumeSource& volume, const SurfaceQuery& query) {
    using namespace detail;
    const VolumeDescription description = volume.describe();
    if (!is_marchable(description) || needs_store(wishes_of(description, query))) {
        return std::nullopt;
    }
    return least_slab_memory(SlabReader(volume), description, least_parts(description.nodes));
}

}  // namespace isonest
