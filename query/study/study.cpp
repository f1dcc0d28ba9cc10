#include "query/study/study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include <isonest/error.h>

#include "query/study/cell_indicators.h"
#include "query/study/computed_field.h"
#include "query/study/graph_distance.h"
#include "query/study/true_error.h"
#include "query/study/whole_lattice.h"
#include "query/traverse/traversal.h"
#include "query/values/label_view.h"
#include "query/values/node_sampler.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/format.h"

namespace isonest::detail {
namespace {

/// The field for the interest test, which is beta_0 of section 5.
Field bound_of(const StoreLayout& layout) {
    return layout.tightest_bound().value_or(Field::deviation_bar);
}

/// The extraction of an isosurface of hexahedra with this stop test.
TraversalQuery surface_query(const StoreReader& store, double iso, Field stop, double threshold) {
    const StoreHeader& header = store.layout().header();
    TraversalQuery query;
    query.iso = iso;
    query.stop = stop;
    query.cells = Cells::hexahedra;
    query.tolerance = Tolerance(threshold, {}, {}, header.spacing, header.origin);
    query.bound = bound_of(store.layout());
    query.box = volume_box(store.layout().lattice());
    return query;
}

/// Counts what that extraction visits.
VisitCounts count_surface(ChunkCache& cache, const StoreReader& store, double iso, Field stop,
                          double threshold, std::size_t part_vertices) {
    const PartSink nowhere = [](std::uint64_t, const MeshPart&) {};
    const TraversalCounts counts = traverse(cache, surface_query(store, iso, stop, threshold),
                                            part_vertices, nowhere, silent_progress());
    VisitCounts visits;
    visits.visited = counts.visited;
    visits.leaves = counts.leaves;
    return visits;
}

bool is_of_cells(const AnyField& field) {
    const Field* const stored = std::get_if<Field>(&field);
    return stored != nullptr ? isonest::is_of_cells(*stored)
                             : detail::is_of_cells(std::get<ComputedField>(field).indicator);
}

/// Distribution of the memory; fewer threads are used if there is little.
struct Shares {
    int threads = 1;
    std::uint64_t cache = 0;
    std::size_t part_vertices = 0;
};

Shares share(const StoreReader& store, const StudyOptions& options, std::optional<Field> bound) {
    const StoreLayout& layout = store.layout();
    const std::uint64_t nodes = WholeLattice::heap(layout, bound);
    const std::uint64_t largest = largest_chunk_bytes(layout);
    // One chunk is held, one more is in the cache.
    const std::uint64_t each = decode_heap(largest) + 2 * largest + kIndicatorBoxHeap;
    std::vector<TraversalHeap> extractions;
    for (const AnyField& field : options.fields) {
        if (options.iso && is_of_cells(field)) {
            extractions.emplace_back(layout,
                                     surface_query(store, *options.iso, std::get<Field>(field), 0));
        }
    }
    std::uint64_t least = each;
    for (const TraversalHeap& heap : extractions) {
        least = std::max(least, heap.thread());
    }
    Shares shares;
    const std::string what = "a study of this volume";
    const MemoryShare memory =
        MemoryShare(store.path().string(), options.memory, Workers::count_of(options.threads))
            .without(nodes);
    require_memory(store.path().string(), options.memory, kLibraryHeap + nodes + least, what,
                   {{RemedyKind::smaller_box}});
    shares.threads = memory.threads_of(each, what);
    shares.cache =
        memory.left() - static_cast<std::uint64_t>(shares.threads) * (each - 2 * largest);
    for (const TraversalHeap& heap : extractions) {
        const TraversalBudget budget =
            heap.share(memory.with_threads(shares.threads), store.is_remote(), false);
        shares = {budget.threads, std::min(shares.cache, budget.cache), budget.part_vertices};
    }
    return shares;
}

/// Whether a field of cells in the store can be studied with these options.
bool suit_cells(const StoreLayout& layout, const StudyOptions& options) {
    return !options.plane && !options.power && !options.graphs &&
           (!options.iso || layout.lattice().dimension() == 3);
}

/// Throws Error{invalid_argument} if the field is one of cells that cannot be studied with these
/// options.
void require_suited(const StoreLayout& layout, const StudyOptions& options, const AnyField& field) {
    if (!is_of_cells(field)) {
        return;
    }
    // Only AdaptTraverse on stored numbers visits the cells of an isosurface.
    const bool computed = std::holds_alternative<ComputedField>(field);
    if (!suit_cells(layout, options) || (computed && options.iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} is a field of hexahedral or quadrilateral cells, which do not "
                                "support a study of {}",
                                name_of(field),
                                options.plane    ? "a slice"
                                : options.power  ? "the norms of the gradient"
                                : options.graphs ? "the distance of graphs"
                                : layout.lattice().dimension() == 3
                                    ? "an isosurface, because its numbers are not in the store"
                                    : "isolines"));
    }
}

/// Throws Error{invalid_argument} for invalid options.
void require_sense(const StoreLayout& layout, const StudyOptions& options) {
    for (const AnyField& field : options.fields) {
        require_suited(layout, options, field);
        if (const Field* const stored = std::get_if<Field>(&field)) {
            static_cast<void>(layout.array(std::min(1, layout.lattice().top()), *stored));
        } else if (!std::get<ComputedField>(field).saturation) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("{} is not saturated: a mesh that it stops has cracks; {}_bar "
                                    "and {}_plus are",
                                    name_of(field), name_of(field), name_of(field)));
        }
    }
    if (options.steps < 2 || !(options.least > 0) || !(options.least < 1)) {
        throw Error(ErrorKind::invalid_argument,
                    "a study needs at least 2 thresholds, the smallest between 0 and 1");
    }
    if (options.plane && layout.lattice().dimension() != 3) {
        throw Error(ErrorKind::invalid_argument,
                    "a study of a slice needs a volume with an extent along all three axes");
    }
    if (options.power && !(*options.power >= 1 && *options.power <= kMaxPower)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("the power of a norm must be between 1 and {}", kMaxPower));
    }
    if (options.plane && (options.power || options.graphs)) {
        throw Error(
            ErrorKind::invalid_argument,
            "the norms of the gradient and the distance of graphs are computed only for the "
            "whole volume");
    }
    if ((options.power || options.graphs) && layout.lattice().dimension() == 0) {
        throw Error(ErrorKind::invalid_argument, "a single node has no elements");
    }
    if (options.plane && options.iso) {
        throw Error(ErrorKind::invalid_argument,
                    "a study is either of a slice or of an isosurface, not both");
    }
}

/// Requires right-angled axes where lengths and gradients are used. Values, and volumes relative to
/// the whole, do not depend on this.
void require_shape(const StoreReader& store, const StudyOptions& options) {
    const Directions& direction = store.layout().header().direction;
    const std::string name = store.path().string();
    require_even_axes(store.layout().header(), name, "a study");
    const bool computes =
        std::any_of(options.fields.begin(), options.fields.end(),
                    [](const AnyField& f) { return std::holds_alternative<ComputedField>(f); });
    for (const auto& [is_asked, what] :
         {std::pair{options.power.has_value(), "the study of true errors"},
          std::pair{options.graphs, "the distance of graphs"},
          std::pair{options.plane.has_value(), "the study of a slice"},
          std::pair{computes, "an indicator that is computed for the study"}}) {
        if (is_asked) {
            require_right_angles(direction, name, what);
        }
    }
}

}  // namespace

Study study(const StoreReader& store, StudyOptions options, Progress& progress) {
    const StoreLayout& layout = store.layout();
    require_numbers(store, "a study");
    if (options.fields.empty()) {
        for (const Field field : layout.header().fields) {
            if (!is_of_cells(field) || suit_cells(layout, options)) {
                options.fields.emplace_back(field);
            }
        }
    }
    require_sense(layout, options);
    require_shape(store, options);
    std::optional<LatticePlane> plane;
    if (options.plane) {
        plane = lattice_plane(layout.header(), *options.plane);
    }
    const LatticePlane* const cut = plane ? &*plane : nullptr;
    std::optional<Field> bound;
    if (options.iso && !std::all_of(options.fields.begin(), options.fields.end(),
                                    [](const AnyField& f) { return is_of_cells(f); })) {
        bound = bound_of(layout);
        static_cast<void>(layout.array(std::min(1, layout.lattice().top()), *bound));
    }
    const Shares shares = share(store, options, bound);
    Study result;
    Workers(shares.threads).execute([&] {
        WholeLattice whole(layout, bound);
        ChunkCache cache(store, shares.cache);
        whole.load_values(cache);
        if (bound) {
            whole.load_bound(cache, progress);
        }
        const double range = store.max_value() - store.min_value();
        result.all_elements = whole.count(-1, cut).leaves;
        if (plane && result.all_elements == 0) {
            throw Error(ErrorKind::invalid_argument, {store.path().string()},
                        "the plane misses the volume");
        }
        result.all_cells = layout.lattice().elements_at(0).product();
        const double unit = range > 0 ? range : 1;
        std::optional<TrueError> true_error;
        if (options.power) {
            true_error.emplace(whole, layout.header().spacing, unit, *options.power);
        }
        for (const AnyField& field : options.fields) {
            const Field* const stored = std::get_if<Field>(&field);
            const bool cells = is_of_cells(field);
            const double largest = stored == nullptr
                                       ? compute_indicator(whole, std::get<ComputedField>(field),
                                                           layout.header().spacing, progress)
                                   : cells ? load_cell_numbers(whole, cache, *stored, progress)
                                           : whole.load_indicator(cache, *stored, progress);
            progress.begin(name_of(field), static_cast<std::uint64_t>(options.steps), "thresholds");
            for (int step = 0; step < options.steps; ++step) {
                progress.check();
                StudyRow row;
                row.field = field;
                row.threshold = std::pow(options.least, static_cast<double>(step) /
                                                            static_cast<double>(options.steps - 1));
                const double threshold = row.threshold * largest;
                row.nodes = cells ? project_on_cells(whole, threshold) : whole.project(threshold);
                const VisitCounts counts =
                    cells ? whole.count_cells(threshold) : whole.count(threshold, cut);
                row.visited = counts.visited;
                row.leaves = counts.leaves;
                row.norms = plane ? plane_error(whole, *plane, layout.header().spacing, unit)
                                  : whole.measure(unit);
                if (true_error) {
                    row.true_norms = true_error->measure();
                }
                if (options.graphs) {
                    row.graph_distance =
                        graph_distance(whole, layout.header().spacing, unit, progress);
                }
                if (options.iso) {
                    const VisitCounts surface =
                        cells ? count_surface(cache, store, *options.iso, *stored, threshold,
                                              shares.part_vertices)
                              : whole.count_surface(threshold, *options.iso);
                    row.iso_visited = surface.visited;
                    row.iso_leaves = surface.leaves;
                }
                result.rows.push_back(row);
                progress.advance(1);
            }
        }
    });
    return result;
}

}  // namespace isonest::detail

namespace isonest {

Study study(const Store& store, const StudyOptions& options, Progress& progress) {
    return detail::study(store.reader(), options, progress);
}

}  // namespace isonest
