#include "query/study/export_computed.h"

#include <vector>

#include <isonest/error.h>

#include "query/study/compute_indicator.h"
#include "query/study/whole_lattice.h"
#include "query/view/label_view.h"
#include "store/base/memory_budget.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"

namespace isonest::detail {

void export_computed_field(const StoreReader& store, const std::filesystem::path& path,
                           const ExportComputedOptions& options, Progress& progress) {
    require_numbers(store, "an indicator");
    check_output(path, options.force, {store.path()});
    const StoreLayout& layout = store.layout();
    const StoreHeader& header = layout.header();
    if (options.level > layout.lattice().top()) {
        // Names the levels that there are.
        static_cast<void>(layout.array(options.level, Field::values));
    }
    const Int3 n = header.nodes;
    const std::uint64_t largest = largest_chunk_bytes(layout);
    const std::uint64_t fixed = kLibraryHeap + decode_heap(largest) + 2 * largest +
                                static_cast<std::uint64_t>(n.x * n.y) * sizeof(float);
    const std::uint64_t least = WholeLattice::heap(layout) + fixed;
    require_memory(store.path().string(), options.memory, least,
                   "an indicator that is computed for the whole volume");
    VolumeFileSpec spec;
    spec.nodes = n;
    spec.type = ValueType::f32;
    spec.spacing = header.spacing;
    spec.origin = header.origin;
    spec.direction = header.direction;
    spec.unit = header.unit;
    spec.frame = header.frame;
    spec.force = options.force;
    const auto file = create_volume_file(path, spec);
    WholeLattice whole(layout);
    {
        ChunkCache cache(store, 2 * largest);
        whole.load_values(cache);
    }
    compute_indicator(whole, options.field, header.spacing, progress);
    progress.begin("export", static_cast<std::uint64_t>(n.z), "planes");
    std::vector<float> plane(static_cast<std::size_t>(n.x * n.y));
    for (std::int64_t z = 0; z < n.z; ++z) {
        progress.check();
        for (std::int64_t i = 0; i < n.x * n.y; ++i) {
            const Int3 p{i % n.x, i / n.x, z};
            const NodeInfo node = describe_node(p, layout.lattice().top());
            const bool is_wanted = node.scale > 0 && node.level() >= options.level;
            plane[static_cast<std::size_t>(i)] = is_wanted ? whole.indicator(p) : 0;
        }
        file->write(reinterpret_cast<const std::byte*>(plane.data()), 1);
        progress.advance(1);
    }
    file->finish();
}

}  // namespace isonest::detail
