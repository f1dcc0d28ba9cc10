#include "query/export.h"

#include <bit>
#include <cmath>
#include <vector>

#include "query/brick_view.h"
#include "query/finest_indicators.h"
#include "query/topology.h"
#include "store/error.h"
#include "store/gather.h"
#include "store/output_file.h"
#include "store/volume_file.h"

namespace isonest {
namespace {

template <class T>
void export_values(const ArrayInfo& array, ChunkCache& cache, VolumeFile& file,
                   Progress& progress) {
    Box<T> plane({0, 0, 0}, {array.nodes.x, array.nodes.y, 1});
    for (std::int64_t z = 0; z < array.nodes.z; ++z) {
        progress.check();
        plane.lo.z = z;
        gather_values(cache, array, plane);
        file.write(reinterpret_cast<const std::byte*>(plane.data.data()), 1);
        progress.advance(1);
    }
}

/// Level 1: the cubes' centres are stored, faces and edges follow from the values.
template <class T>
void finest_plane(const StoreReader& store, ChunkCache& cache, Field field, std::int64_t z,
                  std::vector<float>& plane) {
    const StoreLayout& layout = store.layout();
    const Int3 n = layout.lattice().nodes();
    const Int3 cells = layout.lattice().elements_at(1);
    const std::int64_t cz = std::min(z / 2, cells.z - 1);
    const ArrayInfo& array = layout.array(1, field);
    const bool plus = saturation_of(field) == Saturation::plus;
    Box<T> values({0, 0, 2 * cz}, {2 * cells.x + 1, 2 * cells.y + 1, 3});
    gather_values(cache, layout.array(0, Field::values), values);
    for (std::int64_t cy = 0; cy < cells.y; ++cy) {
        for (std::int64_t gx = 0; gx < array.grid.x; ++gx) {
            const Int3 base = array.first_node(array.chunk_of({gx * array.chunk.x, cy, cz}));
            IndicatorView centres(cache, array, base);
            const std::int64_t end = std::min(base.x + array.chunk.x, cells.x);
            for (std::int64_t cx = base.x; cx < end; ++cx) {
                const Int3 cube{cx, cy, cz};
                // finest_indicator() wants the all-even corner first: mirror the odd cubes.
                const unsigned mirror = mirror_of(cube);
                const CubeValues u = cube_values(values, cube);
                for (int p = 0; p < 27; ++p) {
                    const Int3 at = cube * 2 + node_offset(p, mirror);
                    const bool refines = ((at.x | at.y | at.z) & 1) != 0;
                    if (at.z != z || at.x >= n.x || at.y >= n.y || !refines) {
                        continue;
                    }
                    const bool centre = slot_of(at) == array.first_slot;
                    plane[static_cast<std::size_t>(at.y * n.x + at.x)] =
                        centre ? static_cast<float>(centres.at(cube - base, array.first_slot))
                               : round_up_to_float(finest_indicator(u, p, plus));
                }
            }
        }
    }
}

/// One plane of the nodal array: the node's level and slot follow from its coordinates.
void indicator_plane(const StoreReader& store, ChunkCache& cache, const ExportOptions& options,
                     std::int64_t z, std::vector<float>& plane) {
    const StoreLayout& layout = store.layout();
    const Lattice& lattice = layout.lattice();
    const Int3 n = lattice.nodes();
    std::fill(plane.begin(), plane.end(), 0.0F);
    const bool derived = centre_suffices_at_level_1(options.field);
    if (derived && options.level <= 1 && lattice.top() >= 1) {
        dispatch(layout.header().type, [&](auto tag) {
            finest_plane<typename decltype(tag)::type>(store, cache, options.field, z, plane);
        });
    }
    for (int level = std::max(options.level, derived ? 2 : 1); level <= lattice.top(); ++level) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        if (z % scale != 0) {
            break;  // no node of this plane is on a coarser lattice
        }
        const ArrayInfo& array = layout.array(level, options.field);
        const std::int64_t pz = z / scale;
        for (std::int64_t cy = 0; cy < array.grid.y; ++cy) {
            for (std::int64_t cx = 0; cx < array.grid.x; ++cx) {
                const Int3 chunk{cx, cy, pz / 2 / array.chunk.z};
                const Int3 base = array.first_node(chunk);
                IndicatorView view(cache, array, base);
                const Int3 end = min(base + array.chunk, array.nodes);
                for (std::int64_t py = 2 * base.y; py < 2 * end.y && py * scale < n.y; ++py) {
                    for (std::int64_t px = 2 * base.x; px < 2 * end.x && px * scale < n.x; ++px) {
                        const Int3 p{px, py, pz};
                        if (((px | py | pz) & 1) == 0 || slot_of(p) >= array.components) {
                            continue;
                        }
                        plane[static_cast<std::size_t>(py * scale * n.x + px * scale)] =
                            static_cast<float>(
                                view.at(Int3{px / 2, py / 2, pz / 2} - base, slot_of(p)));
                    }
                }
            }
        }
    }
}

}  // namespace

void export_field(const StoreReader& store, const std::filesystem::path& path,
                  const ExportOptions& options, Progress& progress) {
    check_output(path, options.force, {store.path()});
    const StoreLayout& layout = store.layout();
    const StoreHeader& header = layout.header();
    VolumeFileSpec spec;
    spec.origin = header.origin;
    spec.spacing = header.spacing;
    spec.force = options.force;
    ChunkCache cache(store, options.memory);
    if (options.field == Field::values) {
        const ArrayInfo& array = layout.array(options.level, Field::values);
        spec.nodes = array.nodes;
        spec.type = header.type;
        for (double& s : spec.spacing) {
            s *= static_cast<double>(std::int64_t{1} << options.level);
        }
        const auto file = create_volume_file(path, spec);
        progress.begin("export", static_cast<std::uint64_t>(array.nodes.z), "planes");
        dispatch(header.type, [&](auto tag) {
            export_values<typename decltype(tag)::type>(array, cache, *file, progress);
        });
        return file->finish();
    }
    // Names the fields there are, or the levels, if the wanted ones are not.
    if (layout.lattice().top() > 0 || !layout.has(options.field)) {
        static_cast<void>(layout.array(std::max(options.level, 1), options.field));
    }
    spec.nodes = header.nodes;
    spec.type = ValueType::f32;
    const auto file = create_volume_file(path, spec);
    progress.begin("export", static_cast<std::uint64_t>(spec.nodes.z), "planes");
    std::vector<float> plane(static_cast<std::size_t>(spec.nodes.x * spec.nodes.y));
    for (std::int64_t z = 0; z < spec.nodes.z; ++z) {
        progress.check();
        indicator_plane(store, cache, options, z, plane);
        file->write(reinterpret_cast<const std::byte*>(plane.data()), 1);
        progress.advance(1);
    }
    file->finish();
}

}  // namespace isonest
