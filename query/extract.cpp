#include "query/extract.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <chrono>
#include <cmath>
#include <limits>

#include "query/contour_lines.h"
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

double tolerance_of(const StoreReader& store, const ExtractOptions& options) {
    if (options.error && options.error_relative) {
        throw Error(
            ErrorKind::invalid_argument,
            "give the error either in units of the data or relative to its range, not both");
    }
    double tolerance = options.error.value_or(0);
    if (options.error_relative) {
        // Each part by itself: the range of doubles may be beyond them.
        const double r = *options.error_relative;
        tolerance = store.max_value() > store.min_value()
                        ? r * store.max_value() - r * store.min_value()
                        : r * 0;
    }
    if (!(tolerance >= 0) || !std::isfinite(tolerance)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("error {}: must be a finite number >= 0", tolerance));
    }
    return tolerance;
}

void require(const StoreReader& store, Field field, const std::string& what) {
    const StoreLayout& layout = store.layout();
    if (!layout.has(field) && layout.lattice().top() > 0) {
        std::vector<Field> wanted = layout.header().fields;
        wanted.push_back(field);
        throw Error(
            ErrorKind::not_found,
            fmt::format(
                "{}: {} needs the field {}; the store has {}. Choose another, or preprocess "
                "the volume again with --indicators {}",
                store.path().string(), what, name_of(field),
                layout.header().fields.empty() ? "none" : list_names(layout.header().fields),
                fmt::join(names_of(wanted), ",")));
    }
}

/// The stop field that the options name, and the tightest sound bound that the store has.
void choose_fields(const StoreReader& store, const ExtractOptions& options, TraversalQuery& query) {
    switch (options.guarantee) {
        case Guarantee::deviation:
            query.stop = Field::deviation_bar;
            break;
        case Guarantee::plus:
            query.stop = Field::linf_plus;
            break;
        case Guarantee::estimate:
            query.stop = Field::linf_bar;
            break;
    }
    query.stop = options.stop.value_or(query.stop);
    require(store, query.stop, options.stop ? "--stop" : "this --guarantee");
    if (options.bound) {
        if (!is_bound(*options.bound)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--bound {}: this field bounds nothing; deviation_bar, "
                                    "deviation_plus, linf_plus and grad_linf_plus do",
                                    name_of(*options.bound)));
        }
        require(store, *options.bound, "--bound");
        query.bound = *options.bound;
        return;
    }
    if (!query.plane && !options.graph_scale) {
        const std::optional<Field> tightest = store.layout().tightest_bound();
        query.bound = tightest.value_or(Field::deviation_bar);
        require(store, query.bound, "the search for the surface");
    } else {
        query.bound = store.layout().tightest_bound().value_or(query.stop);  // not used
    }
}

/// Triangles have isolines and a graph, tetrahedra surfaces and slices.
void require_dimension(const StoreReader& store, const std::filesystem::path& mesh,
                       const ExtractOptions& options) {
    const Int3 n = store.layout().lattice().nodes();
    const int dimension = store.layout().lattice().dimension();
    const auto refuse = [&](const char* what) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{}: {} x {} x {} nodes: {}", store.path().string(), n.x, n.y, n.z, what));
    };
    if (dimension == 3 && options.graph_scale) {
        refuse("--graph needs data in a plane, one node along z");
    }
    if (dimension == 2 && options.plane) {
        refuse("a slice needs a volume; draw data in a plane with extract --graph --scale 0");
    }
    if (dimension == 2 && options.view) {
        refuse("--view needs a volume");
    }
    if (dimension == 2 && options.graph_scale && n.z != 1) {
        refuse("--graph needs data in the xy plane, one node along z");
    }
    if (options.graph_scale && !std::isfinite(*options.graph_scale)) {
        throw Error(ErrorKind::invalid_argument, "--scale: must be a finite number");
    }
    if ((dimension == 2 && !options.graph_scale) || !options.contours.empty()) {
        require_lines(mesh);
    }
}

double largest_of(const StoreReader& store, Field field) {
    double largest = 0;
    for (const ArrayInfo& array : store.layout().arrays()) {
        for (std::int64_t i = 0; array.field == field && i < array.grid.product(); ++i) {
            const double max = store.row(array, array.grid.unlinear(i)).max;
            largest = std::isfinite(max) ? std::max(largest, max) : largest;
        }
    }
    return largest;
}

double threshold_of(const StoreReader& store, const ExtractOptions& options) {
    if (!options.stop) {
        return tolerance_of(store, options);
    }
    if (options.error || options.error_relative) {
        throw Error(ErrorKind::invalid_argument,
                    "give either --error or --stop with --threshold, not both");
    }
    if (!(options.threshold >= 0) || !std::isfinite(options.threshold)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("threshold {}: must be a finite number >= 0", options.threshold));
    }
    return options.threshold *
           (options.threshold_relative ? largest_of(store, *options.stop) : 1.0);
}

void choose_culling(const StoreReader& store, const ExtractOptions& options,
                    TraversalQuery& query) {
    if (!options.view) {
        return;
    }
    const Double3& v = *options.view;
    if (!(std::hypot(v[0], v[1], v[2]) > 0) || !std::isfinite(v[0] + v[1] + v[2])) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("view {},{},{}: give a direction, not zero", v[0], v[1], v[2]));
    }
    const bool by_normal = store.layout().has(Field::normal_turn_plus);
    const Field field =
        options.cull_by.value_or(by_normal ? Field::normal_turn_plus : Field::grad_linf_plus);
    if (field != Field::normal_turn_plus && field != Field::grad_linf_plus) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("--cull-by {}: give normal_turn_plus or grad_linf_plus", name_of(field)));
    }
    require(store, field, "--view");
    query.culling.emplace(v, field, store.layout().header().spacing);
}

void choose_attributes(const StoreReader& store, const ExtractOptions& options,
                       TraversalQuery& query) {
    query.attributes.normal = options.normals;
    query.attributes.value = options.values != nullptr || options.plane.has_value();
    query.attributes.error = options.vertex_error;
    if (options.vertex_error) {
        require(store, *options.vertex_error, "--vertex-error");
    }
    if (options.values != nullptr &&
        options.values->layout().header().nodes != store.layout().header().nodes) {
        const Int3 a = store.layout().header().nodes;
        const Int3 b = options.values->layout().header().nodes;
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}: has {} x {} x {} nodes, {} has {} x {} x {}; vertex values "
                                "need the same lattice",
                                options.values->path().string(), b.x, b.y, b.z,
                                store.path().string(), a.x, a.y, a.z));
    }
}

/// In lattice coordinates, its normal so that something lies strictly below the plane where the
/// plane touches the volume: a slice along the volume's border then is not empty.
std::optional<LatticePlane> lattice_plane(const StoreReader& store, const ExtractOptions& options) {
    if (!options.plane) {
        return {};
    }
    const WorldPlane& world = *options.plane;
    const StoreHeader& header = store.layout().header();
    LatticePlane plane;
    plane.offset = world.offset;
    double size = 0;
    double low = 0;  // of n . p over the volume
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        plane.normal[a] = world.normal[a] * header.spacing[a];
        plane.offset -= world.normal[a] * header.origin[a];
        size += std::fabs(world.normal[a]);
        low += std::min(0.0, plane.normal[a] * static_cast<double>(header.nodes[axis] - 1));
    }
    if (!(size > 0) || !std::isfinite(size) || !std::isfinite(world.offset)) {
        throw Error(ErrorKind::invalid_argument,
                    "plane: the normal must be finite and not zero, the offset finite");
    }
    if (low >= plane.offset) {
        for (double& n : plane.normal) {
            n = -n;
        }
        plane.offset = -plane.offset;
    }
    return plane;
}

void require_contours(const ExtractOptions& options) {
    if (options.contours.empty()) {
        return;
    }
    if (!options.plane) {
        throw Error(ErrorKind::invalid_argument, "contours: only of a slice");
    }
    if (options.normals || options.vertex_error) {
        throw Error(ErrorKind::invalid_argument,
                    "contours: lines carry their value, no normals and no --vertex-error");
    }
    if (options.contours.size() > kMostContours) {
        throw Error(ErrorKind::limit, fmt::format("contours: {} values; at most {} at once",
                                                  options.contours.size(), kMostContours));
    }
    for (const double value : options.contours) {
        if (!std::isfinite(value)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("contours: {}: must be a finite number", value));
        }
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

/// A slice along an axis within the box is not to be cut along that axis: what lies in the box's
/// own face would be lost.
void keep_on_border(TraversalQuery& query) {
    for (std::size_t axis = 0; axis < 3 && query.plane; ++axis) {
        const Double3& n = query.plane->normal;
        if (n[(axis + 1) % 3] != 0 || n[(axis + 2) % 3] != 0) {
            continue;
        }
        const double at = query.plane->offset / n[axis];
        if (at >= query.box.lo[axis] && at <= query.box.hi[axis]) {
            query.box.lo[axis] = -std::numeric_limits<double>::infinity();
            query.box.hi[axis] = std::numeric_limits<double>::infinity();
        }
    }
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
    require_dimension(store, mesh, options);
    require_contours(options);
    if (!options.plane && !options.graph_scale && !std::isfinite(options.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", options.iso));
    }
    check_output(mesh, options.force);
    static_cast<void>(mesh_format_of(mesh));
    TraversalQuery query;
    query.iso = options.iso;
    const StoreHeader& header = store.layout().header();
    query.plane = lattice_plane(store, options);
    choose_fields(store, options, query);
    const double threshold = threshold_of(store, options);
    query.tolerance =
        Tolerance(threshold, options.focus, options.camera, header.spacing, header.origin);
    choose_culling(store, options, query);
    choose_attributes(store, options, query);
    query.box = clip_box(store, options.box);
    keep_on_border(query);
    const bool planar = store.layout().lattice().dimension() == 2;
    Double3 spacing = header.spacing;
    Double3 origin = header.origin;
    for (std::size_t axis = 0; axis < 3 && planar; ++axis) {
        if (header.nodes[static_cast<int>(axis)] == 1) {
            constexpr double kInfinity = std::numeric_limits<double>::infinity();
            query.box.lo[axis] = -kInfinity;
            query.box.hi[axis] = kInfinity;
        }
    }
    if (options.graph_scale) {
        spacing[2] = *options.graph_scale;
        origin[2] = 0;
        query.attributes.graph_scale = options.graph_scale;
    }
    const Budget budget = share(store, options, query);

    ExtractReport report;
    report.dimension = store.layout().lattice().dimension();
    report.tolerance = threshold;
    report.stop = query.stop;
    report.bound = query.bound;
    if (query.culling) {
        report.culled_by = query.culling->field();
    }
    const std::uint64_t chunks_before = store.chunks_read();
    const std::uint64_t bytes_before = store.bytes_read();
    Workers(budget.threads).execute([&] {
        PartStore parts(mesh.parent_path(), spacing, origin, budget.parts,
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
