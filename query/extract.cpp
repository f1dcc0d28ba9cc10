#include "query/extract.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <vector>

#include "query/contour_lines.h"
#include "query/extract_query.h"
#include "query/mesh_writer.h"
#include "query/part_store.h"
#include "query/planar.h"
#include "query/traversal.h"
#include "query/weld.h"
#include "store/error.h"
#include "store/output_file.h"
#include "store/workers.h"

namespace isonest {
namespace {

constexpr std::uint64_t kLibraryHeap = 24U << 20U;
constexpr std::uint64_t kReserve = 4U << 20U;  ///< of a thread, for what is not counted

struct Budget {
    int threads;
    std::size_t part_vertices;
    std::uint64_t parts;
    std::uint64_t cache;
};

/// Shares the memory among threads; fewer threads run where there is little.
Budget share(const StoreReader& store, const ExtractOptions& options, const TraversalQuery& query) {
    const std::uint64_t brick = brick_heap(store.layout(), query) +
                                codec_heap(store.layout().array(0, Field::values).chunk_bytes(),
                                           store.layout().header().compression);
    constexpr std::uint64_t kLeastPart = 4096;
    const std::uint64_t table = table_heap(store.layout());
    const std::uint64_t each = brick + table + 2 * kLeastPart * LocalMesh::kBytesPerVertex;
    if (options.memory < kLibraryHeap + each) {
        throw Error(
            ErrorKind::limit,
            fmt::format("{}: a memory of {} MiB is too little for this store's chunks: give "
                        "at least --memory {}M",
                        store.path().string(), options.memory >> 20U,
                        ((kLibraryHeap + each) >> 20U) + 1));
    }
    const int wanted = Workers::count_of(options.threads);
    const std::uint64_t usable = options.memory - kLibraryHeap;
    Budget budget{};
    budget.threads = static_cast<int>(
        std::clamp<std::uint64_t>(usable / each, 1, static_cast<std::uint64_t>(wanted)));
    const auto threads = static_cast<std::uint64_t>(budget.threads);
    const std::uint64_t spare = usable - threads * each;
    budget.part_vertices = std::clamp<std::size_t>(
        spare / 4 / threads / (2 * LocalMesh::kBytesPerVertex), kLeastPart, 65536);
    const std::uint64_t larger_parts =
        threads * 2 * (budget.part_vertices - kLeastPart) * LocalMesh::kBytesPerVertex;
    const std::uint64_t reserve = std::min(spare / 8, threads * kReserve);
    budget.parts = spare / 2;
    // A brick's chunks lie in the cache.
    budget.cache = threads * 8 * store.layout().array(0, Field::values).chunk_bytes() + spare -
                   larger_parts - reserve - budget.parts;
    return budget;
}

}  // namespace

ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                      const ExtractOptions& options, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::filesystem::path> inputs{store.path()};
    if (options.values != nullptr) {
        inputs.push_back(options.values->path());
    }
    check_output(mesh, options.force, inputs);
    ExtractQuery asked = extract_query(store, mesh, options);
    TraversalQuery& query = asked.traversal;
    const bool planar = store.layout().lattice().dimension() == 2;
    const Budget budget = share(store, options, query);

    ExtractReport report;
    report.dimension = store.layout().lattice().dimension();
    report.tolerance = asked.threshold;
    report.coordinate_rounding = asked.coordinate_rounding;
    report.stop = query.stop;
    report.bound = query.bound;
    if (query.culling) {
        report.culled_by = query.culling->field();
    }
    const std::uint64_t chunks_before = store.chunks_read();
    const std::uint64_t bytes_before = store.bytes_read();
    Workers(budget.threads).execute([&] {
        PartStore parts(mesh.parent_path(), asked.spacing, asked.origin, budget.parts,
                        query.attributes.width());
        {
            std::optional<ChunkCache> values;
            if (options.values != nullptr) {
                values.emplace(*options.values, budget.cache / 4);
                query.attribute_values = &*values;
            }
            ChunkCache cache(store, budget.cache - (values ? budget.cache / 4 : 0));
            const PartSink sink = [&](std::uint64_t order, const MeshPart& part) {
                parts.append(order, part);
            };
            const TraversalCounts counts =
                planar ? traverse_planar(
                             cache, query,
                             options.graph_scale ? PlanarKind::graph : PlanarKind::isolines,
                             budget.part_vertices, sink, progress)
                       : traverse(cache, query, budget.part_vertices, sink, progress);
            report.visited_tetrahedra = counts.visited;
            report.leaf_tetrahedra = counts.leaves;
            report.bricks = counts.bricks;
            report.error_bound = counts.error_bound;
            report.peak_cache_bytes = cache.peak_bytes();
        }
        parts.seal();
        progress.check();
        const Weld weld(parts, mesh.parent_path());
        const bool lines = planar && !options.graph_scale;
        if (options.contours.empty()) {
            write_mesh(mesh, options.force, parts, weld, query.attributes, lines, progress);
            report.vertices = weld.vertices();
            report.triangles = weld.triangles();
            report.zero_area_triangles = lines ? 0 : parts.zero_area_triangles();
            return;
        }
        PartStore line_parts(mesh.parent_path(), {1, 1, 1}, {0, 0, 0}, budget.cache / 2, 1);
        contour_lines(
            parts, weld, options.contours, 0, budget.part_vertices,
            [&](std::uint64_t order, const MeshPart& part) { line_parts.append(order, part); },
            progress);
        line_parts.seal();
        const Weld line_weld(line_parts, mesh.parent_path());
        write_mesh(mesh, options.force, line_parts, line_weld, query.attributes, true, progress);
        report.vertices = line_weld.vertices();
        report.triangles = line_weld.triangles();
    });
    report.chunks_total = store.layout().rows();
    report.chunks_read = store.chunks_read() - chunks_before;
    report.bytes_read = store.bytes_read() - bytes_before;
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest
