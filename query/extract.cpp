#include "query/extract.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>

#include "query/part_store.h"
#include "query/ply_writer.h"
#include "query/traversal.h"
#include "query/weld.h"
#include "store/error.h"
#include "store/output_file.h"
#include "store/workers.h"

namespace isonest {
namespace {

constexpr std::uint64_t kLibraryHeap = 24U << 20U;

double tolerance_of(const StoreReader& store, const ExtractOptions& options) {
    if (options.error && options.error_relative) {
        throw Error(
            ErrorKind::invalid_argument,
            "give the error either in units of the data or relative to its range, not both");
    }
    double tolerance = options.error.value_or(0);
    if (options.error_relative) {
        const double range = store.max_value() - store.min_value();
        tolerance = *options.error_relative * (range > 0 ? range : 0);
    }
    if (!(tolerance >= 0) || !std::isfinite(tolerance)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("error {}: must be a finite number >= 0", tolerance));
    }
    return tolerance;
}

void require(const StoreReader& store, Field field, const char* guarantee) {
    const StoreLayout& layout = store.layout();
    if (!layout.has(field) && layout.lattice().top() > 0) {
        throw Error(ErrorKind::not_found,
                    fmt::format("{}: --guarantee {} needs the field {}; the store has {}. Choose "
                                "another guarantee or preprocess again with --indicators {}",
                                store.path().string(), guarantee, name_of(field),
                                layout.header().fields.empty() ? "none"
                                                               : list_names(layout.header().fields),
                                name_of(field)));
    }
}

/// The stop field that the guarantee names, and the tightest sound bound that the store has.
void choose_fields(const StoreReader& store, Guarantee guarantee, TraversalQuery& query) {
    const bool deviation = store.layout().has(Field::deviation_bar);
    switch (guarantee) {
        case Guarantee::deviation:
            require(store, Field::deviation_bar, "deviation");
            query.stop = Field::deviation_bar;
            query.bound = Field::deviation_bar;
            break;
        case Guarantee::plus:
            require(store, Field::linf_plus, "plus");
            query.stop = Field::linf_plus;
            query.bound = deviation ? Field::deviation_bar : Field::linf_plus;
            break;
        case Guarantee::estimate:
            require(store, Field::linf_bar, "estimate");
            query.stop = Field::linf_bar;
            if (!deviation) {
                require(store, Field::linf_plus, "estimate");
            }
            query.bound = deviation ? Field::deviation_bar : Field::linf_plus;
            break;
    }
}

ClipBox clip_box(const StoreReader& store, const std::optional<WorldBox>& box) {
    const StoreHeader& header = store.layout().header();
    ClipBox clip;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        clip.hi[a] = static_cast<double>(header.nodes[axis] - 1);
        if (!box) {
            continue;
        }
        if (!(box->lo[a] < box->hi[a])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("box: {} to {} along {} is empty; give x0,y0,z0,x1,y1,z1 with "
                                    "the low corner first",
                                    box->lo[a], box->hi[a], "xyz"[a]));
        }
        clip.lo[a] = std::max(clip.lo[a], (box->lo[a] - header.origin[a]) / header.spacing[a]);
        clip.hi[a] = std::min(clip.hi[a], (box->hi[a] - header.origin[a]) / header.spacing[a]);
    }
    return clip;
}

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
    const std::uint64_t each = brick + 2 * kLeastPart * LocalMesh::kBytesPerVertex;
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
    const std::uint64_t threads = static_cast<std::uint64_t>(budget.threads);
    const std::uint64_t spare = usable - threads * each;
    budget.part_vertices = std::clamp<std::size_t>(
        spare / 4 / threads / (2 * LocalMesh::kBytesPerVertex), kLeastPart, 65536);
    const std::uint64_t rest =
        usable - threads * (2 * budget.part_vertices * LocalMesh::kBytesPerVertex + (4U << 20U));
    budget.parts = spare / 4;
    budget.cache = rest - budget.parts;
    return budget;
}

}  // namespace

ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                      const ExtractOptions& options, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    if (!std::isfinite(options.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", options.iso));
    }
    check_output(mesh, options.force);
    TraversalQuery query;
    query.iso = options.iso;
    query.epsilon = tolerance_of(store, options);
    choose_fields(store, options.guarantee, query);
    query.box = clip_box(store, options.box);
    const Budget budget = share(store, options, query);

    ExtractReport report;
    report.tolerance = query.epsilon;
    const std::uint64_t chunks_before = store.chunks_read();
    const std::uint64_t bytes_before = store.bytes_read();
    Workers(budget.threads).execute([&] {
        PartStore parts(mesh.parent_path(), store.layout().header().spacing,
                        store.layout().header().origin, budget.parts);
        {
            ChunkCache cache(store, budget.cache);
            const TraversalCounts counts = traverse(
                cache, query, budget.part_vertices,
                [&](std::uint64_t order, const MeshPart& part) { parts.append(order, part); },
                progress);
            report.visited_tetrahedra = counts.visited;
            report.leaf_tetrahedra = counts.leaves;
            report.bricks = counts.bricks;
            report.error_bound = counts.error_bound;
            report.peak_cache_bytes = cache.peak_bytes();
        }
        parts.seal();
        progress.check();
        const Weld weld(parts, mesh.parent_path());
        write_ply(mesh, options.force, parts, weld, progress);
        report.vertices = weld.vertices();
        report.triangles = weld.triangles();
        report.zero_area_triangles = parts.zero_area_triangles();
    });
    report.chunks_total = store.layout().rows();
    report.chunks_read = store.chunks_read() - chunks_before;
    report.bytes_read = store.bytes_read() - bytes_before;
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest
