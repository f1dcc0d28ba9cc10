#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <string>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/export_field.h>

#include "query/study/computed_field.h"
#include "query/values/label_view.h"
#include "query/values/node_fields.h"
#include "query/values/node_sampler.h"
#include "store/base/label_text.h"
#include "store/base/memory.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"

namespace isonest::detail {
namespace {

/// The memory of an export: boxes of a chunk's nodes along y and z, as long along x as the memory
/// allows.
struct Shares {
    Int3 box;             ///< nodes
    std::uint64_t cache;  ///< bytes
};

std::uint64_t held_for(const VolumeFile& file, const ArrayInfo& array) {
    return file.held(static_cast<std::uint64_t>(array.chunk.y * array.chunk.z));
}

/// `beside`: bytes in addition to the box and the cache.
Shares share(const StoreReader& store, std::uint64_t memory, const ArrayInfo& array,
             std::size_t element, std::uint64_t beside) {
    const std::uint64_t column = static_cast<std::uint64_t>(array.chunk.product()) * element;
    const std::uint64_t largest = largest_chunk_bytes(store.layout());
    // One chunk of values and one of an indicator are held.
    const std::uint64_t fixed = kLibraryHeap + beside + decode_heap(largest) + 2 * largest;
    require_memory(store.path().string(), memory, fixed + column, "this store's chunks");
    const std::uint64_t spare = memory - fixed;
    const std::uint64_t columns =
        std::clamp<std::uint64_t>(spare / 2 / column, 1, static_cast<std::uint64_t>(array.grid.x));
    Shares shares{array.chunk, 2 * largest + spare - columns * column};
    shares.box.x = std::min(array.chunk.x * static_cast<std::int64_t>(columns), array.nodes.x);
    return shares;
}

/// Calls f(lo, size) for all boxes of the lattice, of at most `box` nodes. want(lo, size, chunks)
/// adds the chunks that f reads.
template <class Want, class F>
void for_each_box(const StoreReader& store, const Int3& nodes, const Int3& box, Progress& progress,
                  const Want& want, const F& f) {
    const Int3 grid = ceil_div(nodes, box);
    const auto first_of = [&](std::int64_t i) {
        const Int3 g = grid.unlinear(i);
        return Int3{g.x * box.x, g.y * box.y, g.z * box.z};
    };
    Prefetcher prefetcher(store, 0, grid.product(),
                          [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                              const Int3 lo = first_of(i);
                              want(lo, min(box, nodes - lo), chunks);
                          });
    progress.begin("export", static_cast<std::uint64_t>(grid.product()), "boxes");
    for (std::int64_t i = 0; i < grid.product(); ++i) {
        progress.check();
        prefetcher.reach(i);
        const Int3 lo = first_of(i);
        f(lo, min(box, nodes - lo));
        progress.advance(1);
    }
}

/// Replaces values, in place, by the labels that they represent, as int64.
template <class T>
void to_labels(Box<T>& box) {
    if constexpr (std::is_same_v<T, double>) {
        for (double& value : box.data) {
            const auto label = static_cast<std::int64_t>(label_of_value(value));
            std::memcpy(&value, &label, sizeof(value));
        }
    }
}

template <class T>
void export_values(const StoreReader& store, const ArrayInfo& array, std::uint64_t memory,
                   VolumeFile& file, Progress& progress) {
    const Shares shares = share(store, memory, array, sizeof(T), held_for(file, array));
    ChunkCache cache(store, shares.cache);
    const auto want = [&](const Int3& lo, const Int3& size, std::vector<WantedChunk>& chunks) {
        want_box(array, lo, lo + size - Int3{1, 1, 1}, chunks);
    };
    for_each_box(store, array.nodes, shares.box, progress, want,
                 [&](const Int3& lo, const Int3& size) {
                     Box<T> box(lo, size);
                     gather_values(cache, array, box);
                     if (store.layout().header().labels) {
                         to_labels(box);
                     }
                     file.write_box(lo, size, reinterpret_cast<const std::byte*>(box.data.data()));
                 });
}

/// Adds what fill_indicators() reads for a box and for no earlier box: a chunk belongs to the box
/// that contains the first of its nodes, or the node before that.
void want_indicators(const StoreLayout& layout, Field field, int level, const Int3& box,
                     const Int3& lo, const Int3& size, std::vector<WantedChunk>& chunks) {
    const auto add = [&](const ArrayInfo& array) {
        const std::int64_t stride = std::int64_t{1} << array.level;
        const Int3 hi = lo + size - Int3{1, 1, 1};
        std::vector<WantedChunk> all;
        want_box(array, {lo.x / stride, lo.y / stride, lo.z / stride},
                 {hi.x / stride + 1, hi.y / stride + 1, hi.z / stride + 1}, all);
        std::copy_if(all.begin(), all.end(), std::back_inserter(chunks), [&](const auto& c) {
            const Int3 corner =
                max(array.first_node(c.chunk) * stride - Int3{1, 1, 1} * stride, {0, 0, 0});
            return Int3{corner.x / box.x * box.x, corner.y / box.y * box.y,
                        corner.z / box.z * box.z} == lo;
        });
    };
    const bool derived = centre_suffices_at_level_1(field);
    if (derived && level <= 1) {
        add(layout.array(0, Field::values));
    }
    for (int l = std::max(level, 1); l <= layout.lattice().top(); ++l) {
        add(layout.array(l, field));
    }
}

void export_indicator(const StoreReader& store, Field field, const ExportOptions& options,
                      VolumeFile& file, Progress& progress) {
    const ArrayInfo& values = store.layout().array(0, Field::values);
    const Shares shares = share(store, options.memory, values, sizeof(float),
                                kIndicatorBoxHeap + held_for(file, values));
    ChunkCache cache(store, shares.cache);
    const auto want = [&](const Int3& lo, const Int3& size, std::vector<WantedChunk>& chunks) {
        want_indicators(store.layout(), field, options.level, shares.box, lo, size, chunks);
    };
    for_each_box(
        store, values.nodes, shares.box, progress, want, [&](const Int3& lo, const Int3& size) {
            Box<float> box(lo, size);
            for_each_block(lo, size, values.chunk, [&](const Int3& from, const Int3& count) {
                Box<double> block(from, count);
                fill_indicators(cache, field, options.level, block);
                for (std::int64_t i = 0; i < count.product(); ++i) {
                    box.at(from + count.unlinear(i)) =
                        round_up_to_float(block.data[static_cast<std::size_t>(i)]);
                }
            });
            file.write_box(lo, size, reinterpret_cast<const std::byte*>(box.data.data()));
        });
}

}  // namespace
}  // namespace isonest::detail

namespace isonest {

Int3 export_field(const Store& of, const std::filesystem::path& path, const ExportOptions& options,
                  Progress& progress) {
    using namespace detail;
    const StoreReader& store = of.reader();
    if (std::holds_alternative<ComputedField>(options.field)) {
        export_computed_field(store, path, options, progress);
        return store.layout().header().nodes;
    }
    const Field field = std::get<Field>(options.field);
    check_output(path, options.force, {store.path()});
    const StoreLayout& layout = store.layout();
    const StoreHeader& header = layout.header();
    VolumeFileSpec spec;
    spec.uneven = header.uneven;
    spec.is_curved = header.curved != nullptr;
    spec.origin = header.origin;
    spec.direction = header.direction;
    spec.unit = header.unit;
    spec.frame = header.frame;
    spec.spacing = header.spacing;
    spec.force = options.force;
    if (field == Field::values) {
        const ArrayInfo& array = layout.array(options.level, Field::values);
        spec.nodes = array.nodes;
        spec.type = header.type;
        spec.is_int64 = header.labels;
        for (double& s : spec.spacing) {
            s *= static_cast<double>(std::int64_t{1} << options.level);
        }
        const auto file = create_volume_file(path, spec);
        dispatch(header.type, [&](auto tag) {
            export_values<typename decltype(tag)::type>(store, array, options.memory, *file,
                                                        progress);
        });
        file->finish();
        return array.nodes;
    }
    require_numbers(store, "an indicator");
    require_field_of_nodes(store, field);
    if (layout.lattice().top() > 0) {
        // Throws an error that lists the existing levels if the requested one does not exist.
        static_cast<void>(layout.array(std::max(options.level, 1), field));
    }
    spec.nodes = header.nodes;
    spec.type = ValueType::f32;
    const auto file = create_volume_file(path, spec);
    export_indicator(store, field, options, *file, progress);
    file->finish();
    return header.nodes;
}

}  // namespace isonest
