#include "preprocess/preprocess.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_pipeline.h>
#include <oneapi/tbb/task_group.h>

#include <chrono>
#include <functional>
#include <memory>

#include "preprocess/level_pass.h"
#include "store/error.h"
#include "store/workers.h"
#include "store/writer.h"

namespace isonest {
namespace {

/// HDF5, TBB and the tables.
constexpr std::uint64_t kLibraryHeap = 10U << 20U;
/// The smallest window or cache.
constexpr std::uint64_t kLeastWindow = 6U << 20U;

using Block = std::function<std::vector<EncodedChunk>(const Int3&)>;

/// Computes blocks in parallel, writes their chunks in the order of the blocks, and so gives the
/// same bytes for any number of threads.
void run_blocks(const Int3& grid, int tokens, const Block& compute, StoreWriter& writer,
                Progress& progress, std::uint64_t bytes_per_block) {
    using Result = std::shared_ptr<std::vector<EncodedChunk>>;
    std::int64_t next = 0;
    tbb::parallel_pipeline(
        static_cast<std::size_t>(tokens),
        tbb::make_filter<void, std::int64_t>(tbb::filter_mode::serial_in_order,
                                             [&](tbb::flow_control& control) -> std::int64_t {
                                                 if (next == grid.product()) {
                                                     control.stop();
                                                     return 0;
                                                 }
                                                 progress.check();
                                                 return next++;
                                             }) &
            tbb::make_filter<std::int64_t, Result>(
                tbb::filter_mode::parallel,
                [&](std::int64_t i) {
                    return std::make_shared<std::vector<EncodedChunk>>(compute(grid.unlinear(i)));
                }) &
            tbb::make_filter<Result, void>(
                tbb::filter_mode::serial_in_order, [&](const Result& result) {
                    for (EncodedChunk& chunk : *result) {
                        writer.write_chunk(*chunk.array, chunk.chunk, chunk.bytes, chunk.row);
                        chunk.bytes = {};
                    }
                    progress.advance(bytes_per_block);
                }));
}

StoreHeader header_of(const VolumeSource& source, const PreprocessOptions& options) {
    StoreHeader header;
    header.nodes = source.nodes();
    header.type = source.type();
    header.spacing = source.spacing();
    header.origin = source.origin();
    header.chunk = options.chunk;
    header.compression = options.compression;
    header.exact = options.exact;
    header.fields = options.fields;
    return header;
}

/// How many blocks may be under way, given the budget; at least one must fit.
int token_count(const StoreLayout& layout, const PreprocessOptions& options, int threads,
                const VolumeSource& source) {
    const std::uint64_t block = block_heap(layout);
    const std::uint64_t fixed = kLibraryHeap + source.heap();
    const std::uint64_t least = fixed + block + kLeastWindow;
    if (options.memory < least) {
        throw Error(
            ErrorKind::limit,
            fmt::format("{}: a memory of {} MiB is too little for chunks of {}: give at "
                        "least --memory {}M, or a smaller --chunk",
                        source.name(), options.memory >> 20U, options.chunk, (least >> 20U) + 1));
    }
    const std::uint64_t share = (options.memory - fixed) * 3 / 5 / block;
    return static_cast<int>(
        std::clamp<std::uint64_t>(share, 1, static_cast<std::uint64_t>(threads) + 1));
}

template <class T>
void run_levels(const StoreLayout& layout, StoreWriter& writer, CentreStore& centres,
                PlaneWindow& window, int tokens, std::uint64_t cache_budget, Progress& progress) {
    const Lattice& lattice = layout.lattice();
    const PassContext context{layout, centres};
    const Int3 grid = base_grid(layout);
    const auto volume_bytes = static_cast<std::uint64_t>(lattice.nodes().product()) * sizeof(T);
    const std::uint64_t per_block = volume_bytes / static_cast<std::uint64_t>(grid.product());
    progress.begin("levels 0-2", volume_bytes, "B");
    for (std::int64_t z = 0; z < grid.z; ++z) {
        const auto [begin, end] = base_planes(layout, z);
        window.load(begin, end);
        tbb::task_group reading;
        if (z + 1 < grid.z) {
            reading.run([&] { window.prefetch(base_planes(layout, z + 1).second); });
        }
        try {
            run_blocks(
                {grid.x, grid.y, 1}, tokens,
                [&](const Int3& b) {
                    return base_block<T>(context, window, {b.x, b.y, z});
                },
                writer, progress, per_block);
        } catch (...) {
            try {
                reading.wait();
            } catch (...) {
                // The first failure is the one to report.
            }
            throw;
        }
        reading.wait();
    }
    ChunkCache cache(writer, cache_budget);
    for (int level = 3; level <= lattice.top(); ++level) {
        const Int3 blocks = level_grid(layout, level);
        progress.begin(fmt::format("level {}", level), static_cast<std::uint64_t>(blocks.product()),
                       "blocks");
        run_blocks(
            blocks, tokens,
            [&](const Int3& b) { return level_block_of<T>(context, cache, level, b); }, writer,
            progress, 1);
        centres.release(level - 2);
    }
    if (lattice.top() >= 2) {
        for (const EncodedChunk& chunk : top_values<T>(context, cache)) {
            writer.write_chunk(*chunk.array, chunk.chunk, chunk.bytes, chunk.row);
        }
    }
}

void allocate_centres(const StoreLayout& layout, CentreStore& centres) {
    const int top = layout.lattice().top();
    for (int level = 2; level < top; ++level) {
        for (const Field field : layout.header().fields) {
            centres.allocate(level, field);
        }
    }
}

}  // namespace

PreprocessReport preprocess(VolumeSource& source, const std::filesystem::path& store,
                            const PreprocessOptions& options, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    Workers workers(options.threads);
    const StoreHeader header = header_of(source, options);
    const int tokens = token_count(StoreLayout(header), options, workers.count(), source);
    StoreWriter writer(store, header, options.force);
    const StoreLayout& layout = writer.layout();
    const std::uint64_t in_blocks = static_cast<std::uint64_t>(tokens) * block_heap(layout);
    const std::uint64_t rest =
        options.memory - std::min(options.memory, kLibraryHeap + source.heap() + in_blocks);

    PreprocessReport report;
    workers.execute([&] {
        CentreStore centres(layout.lattice(), store.parent_path());
        allocate_centres(layout, centres);
        const std::int64_t planes = 2 * layout.header().chunk + 8;
        PlaneWindow window(source, planes, rest, store.parent_path(), progress);
        report.input_on_disk = window.on_disk();
        const std::uint64_t cache =
            std::max<std::uint64_t>(rest - std::min(rest, window.heap()), kLeastWindow);
        dispatch(header.type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            run_levels<T>(layout, writer, centres, window, tokens, cache, progress);
        });
    });
    progress.check();
    report.nodes = header.nodes;
    report.levels = layout.lattice().top() + 1;
    report.input_bytes = static_cast<std::uint64_t>(header.nodes.product()) * size_of(header.type);
    report.chunks = layout.rows();
    report.min_value = std::numeric_limits<double>::infinity();
    report.max_value = -report.min_value;
    const ArrayInfo& values = layout.array(0, Field::values);
    for (std::int64_t i = 0; i < values.grid.product(); ++i) {
        const ChunkRow row = writer.row(values, values.grid.unlinear(i));
        report.min_value = std::min(report.min_value, row.min);
        report.max_value = std::max(report.max_value, row.max);
        report.has_missing = report.has_missing || (row.flags & kChunkHasMissing) != 0;
    }
    writer.finish();
    report.store_bytes = std::filesystem::file_size(store);
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest
