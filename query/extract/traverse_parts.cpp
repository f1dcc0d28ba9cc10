// AdaptTraverse with the caller's functions: what <isonest/traverse.h> does not compile with them.
#include <fmt/format.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <mutex>
#include <vector>

#include <isonest/error.h>
#include <isonest/traverse.h>

#include "query/extract/extract_query.h"
#include "query/extract/query_checks.h"
#include "query/traverse/each_leaf.h"
#include "query/traverse/remote/look_ahead.h"
#include "query/values/node_fields.h"
#include "query/values/node_sampler.h"
#include "store/base/in_order.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest {

using detail::StoreLayout;
using detail::StoreReader;

Placement::Placement(const Store& store) : origin_(store.origin()), uneven_(store.uneven_axes()) {
    detail::require_not_curved(store.reader().layout().header(), store.path().string(),
                               "a placement of elements");
    const Directions direction = store.direction();
    std::array<Double3, 3> along{};
    std::size_t count = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::size_t w = 0; w < 3; ++w) {
            step_[axis][w] = direction[axis][w] * store.spacing()[axis];
        }
        if (store.nodes()[static_cast<int>(axis)] > 1) {
            along[count++] = step_[axis];
        }
    }
    using detail::cross;
    using detail::dot;
    using detail::length;
    smallest_ = count == 1   ? length(along[0])
                : count == 2 ? length(cross(along[0], along[1])) / 2
                : count == 3 ? std::fabs(dot(along[0], cross(along[1], along[2]))) / 6
                             : 0;
}

double Placement::even_steps(std::size_t axis, std::int64_t node) const {
    const std::vector<double>& offsets = uneven_->offsets.at(axis);
    if (offsets.empty()) {
        return static_cast<double>(node);
    }
    // Elements may extend beyond the last node.
    const std::int64_t last = std::ssize(offsets) - 1;
    return offsets.at(static_cast<std::size_t>(std::min(node, last))) / offsets.back() *
           static_cast<double>(last);
}

double Placement::size_of(std::span<const Double3> corners) {
    std::array<Double3, 3> along{};
    for (std::size_t i = 1; i < corners.size(); ++i) {
        for (std::size_t w = 0; w < 3; ++w) {
            along.at(i - 1).at(w) = corners[i].at(w) - corners[0].at(w);
        }
    }
    using detail::cross;
    using detail::dot;
    using detail::length;
    return corners.size() == 2   ? length(along[0])
           : corners.size() == 3 ? length(cross(along[0], along[1])) / 2
                                 : std::fabs(dot(along[0], cross(along[1], along[2]))) / 6;
}

int dimension_of(const Store& store) {
    return store.reader().layout().lattice().dimension();
}

MayHoldIsovalue may_hold_isovalue(const Store& store, double iso) {
    const StoreLayout& layout = store.reader().layout();
    const std::optional<Field> bound = layout.tightest_bound();
    if (!bound) {
        throw Error(ErrorKind::not_found, {store.path().string()},
                    "the store has no field that bounds the error; elements without the isovalue "
                    "cannot be skipped",
                    {{RemedyKind::make_fields, std::string(name_of(Field::deviation_bar))}});
    }
    const bool is_gradient = indicator_of(*bound) == Indicator::grad_linf;
    return {iso, *bound, is_gradient ? layout.header().steps().diagonal() : 0};
}

StopBelow stop_below(const Store& store, const StopTest& test) {
    const detail::Stop stop = detail::stop_of(store.reader(), test);
    return {stop.field, stop.threshold};
}

namespace detail {

/// The fields of a store that tests have asked for so far. Thread-safe.
class AskedFields {
  public:
    explicit AskedFields(const std::vector<Field>& fields)
        : fields_(fields), asked_(fields.size()) {}

    /// REQUIRES: the store has the field.
    void add(Field field) {
        const auto found = std::find(fields_.begin(), fields_.end(), field);
        asked_[static_cast<std::size_t>(found - fields_.begin())] = true;
    }
    /// Calls f(field) for each.
    template <class F>
    void for_each(const F& f) const {
        for (std::size_t i = 0; i < fields_.size(); ++i) {
            if (asked_[i]) {
                f(fields_[i]);
            }
        }
    }

  private:
    const std::vector<Field>& fields_;
    std::vector<std::atomic<bool>> asked_;
};

class StoreNodeReader {
  public:
    StoreNodeReader(const StoreReader& store, ChunkCache& cache, AskedFields& asked)
        : store_(store), cache_(cache), asked_(asked), values_(cache) {}

    double value(const Int3& p, int level) { return values_.value(p, level); }
    double indicator(const Int3& x, Field field) {
        for (Slot& slot : slots_) {
            if (slot.sampler && slot.field == field) {
                return slot.sampler->grid_indicator(x, field);
            }
        }
        return take(field).sampler->grid_indicator(x, field);
    }

  private:
    struct Slot {
        Field field = Field::values;
        std::optional<NodeSampler> sampler;
    };

    Slot& take(Field field) {
        require_field_of_nodes(store_, field);
        asked_.add(field);
        Slot& slot = slots_.at(next_);
        next_ = (next_ + 1) % slots_.size();
        slot.field = field;
        slot.sampler.emplace(cache_);
        return slot;
    }

    const StoreReader& store_;
    ChunkCache& cache_;
    AskedFields& asked_;
    NodeSampler values_;
    std::array<Slot, StoreNodes::kFields> slots_;
    std::size_t next_ = 0;
};

StoreNodes::StoreNodes(std::unique_ptr<StoreNodeReader> reader) : reader_(std::move(reader)) {}
StoreNodes::StoreNodes(StoreNodes&&) noexcept = default;
StoreNodes& StoreNodes::operator=(StoreNodes&&) noexcept = default;
StoreNodes::~StoreNodes() = default;

double StoreNodes::value(const Int3& p, int level) {
    return reader_->value(p, level);
}
double StoreNodes::indicator(const Int3& x, Field field) {
    return reader_->indicator(x, field);
}

namespace {

/// Elements overlapping the box, which is along the world's axes, by its extent along the lattice's
/// axes.
LatticeRegion region_of(const StoreHeader& header, const Lattice& lattice,
                        const std::optional<WorldBox>& box) {
    const ClipBox all = volume_box(lattice);
    LatticeRegion region{all.lo, all.hi};
    if (!box) {
        return region;
    }
    for (std::size_t a = 0; a < 3; ++a) {
        if (!(box->lo[a] <= box->hi[a])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("box: {} to {} along {} is empty; the low corner comes first",
                                    box->lo[a], box->hi[a], "xyz"[a]));
        }
    }
    const LatticeSteps steps = header.steps();
    const auto [low, high] = bounds_of_box(box->lo, box->hi, [&](const Double3& world) {
        const Double3 p = unrotated_about(header.origin, header.rotation(), world);
        return steps.steps_of(
            {p[0] - header.origin[0], p[1] - header.origin[1], p[2] - header.origin[2]});
    });
    for (std::size_t a = 0; a < 3; ++a) {
        region.lo[a] = std::max(region.lo[a], low[a]);
        region.hi[a] = std::min(region.hi[a], high[a]);
    }
    return region;
}

/// How the memory is divided.
struct Budget {
    int threads = 1;
    std::uint64_t cache = 0;
};

Budget share_memory(const StoreReader& store, const TraverseOptions& options,
                    const std::optional<std::uint64_t>& part_heap) {
    const StoreLayout& layout = store.layout();
    // A sampler of values and one of each field hold a chunk per level, the latter also of values.
    constexpr std::uint64_t kLists = 4U << 20U;
    std::uint64_t values = 0;
    std::uint64_t finest = 0;
    std::map<Field, std::uint64_t> of_field;
    std::uint64_t most_of_field = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        if (array.field == Field::values) {
            values += array.chunk_bytes();
            finest = array.level == 0 ? array.chunk_bytes() : finest;
        } else {
            most_of_field = std::max(most_of_field, of_field[array.field] += array.chunk_bytes());
        }
    }
    const std::uint64_t held = values + StoreNodes::kFields * (finest + most_of_field);
    const std::uint64_t each = held + finest + decode_heap(largest_chunk_bytes(layout)) + kLists +
                               2 * part_heap.value_or(0);
    const MemoryShare memory(store.path().string(), options.memory,
                             Workers::count_of(options.threads));
    Budget budget;
    budget.threads = memory.threads_of(each, "this store's chunks");
    const auto count = static_cast<std::uint64_t>(budget.threads);
    budget.cache = count * held + memory.left() - count * each;
    return budget;
}

/// A traversal in progress.
template <int D>
class PartsRun {
  public:
    PartsRun(const StoreReader& store, const PartVisitor<D>& visitor, const LatticeRegion& region,
             const Budget& budget, Progress& progress)
        : store_(store),
          visitor_(visitor),
          region_(region),
          cache_(store, budget.cache),
          asked_(store.layout().header().fields),
          nodes_([this] { return make_nodes(); }),
          tokens_(budget.threads + 1),
          is_remote_(store.is_remote()),
          are_joined_(visitor.part_heap().has_value()),
          progress_(progress) {}

    TraverseReport operator()() {
        const Lattice& lattice = store_.layout().lattice();
        const std::vector<Element<D>> roots =
            coarsest_of(lattice, nodes_.local(), std::type_identity<Element<D>>());
        progress_.begin("traverse", roots.size() * roots.front().size(), "");
        if (is_remote_ || are_joined_) {
            in_sequence(roots, lattice.top());
        } else {
            each_leaf::visit_cube<D>(roots, lattice.top(),
                                     [this](const Elements& elements, int /*level*/, int below,
                                            Elements* left) { visit(elements, below, left); });
        }
        return {counts_.visited, counts_.leaves, cache_.chunks_read()};
    }

  private:
    using Elements = std::vector<Element<D>>;
    using Part = typename PartVisitor<D>::Part;

    StoreNodes make_nodes() {
        return StoreNodes(std::make_unique<StoreNodeReader>(store_, cache_, asked_));
    }

    std::unique_ptr<Part> visit(const Elements& elements, int below, Elements* left) {
        progress_.check();
        VisitCounts counts;
        std::unique_ptr<Part> part =
            visitor_.visit(nodes_.local(), region_, elements, below, left, counts, progress_);
        progress_.advance(counts.finished);
        const std::lock_guard lock(mutex_);
        counts_.add(counts);
        return part;
    }
    static void join(const std::unique_ptr<Part>& part) {
        if (part != nullptr) {
            part->join();
        }
    }

    /// The elements of a cube of `level`; parts in order, so that they can be joined and what they
    /// read can be fetched ahead.
    void in_sequence(const Elements& elements, int level) {
        if (level <= part_levels<D>(are_joined_)) {
            look(elements, level, 0);
            join(visit(elements, 0, nullptr));
            return;
        }
        const int below = std::max(level - each_leaf::levels_between(D), 0);
        look(elements, level, below + 1);
        Elements left;
        join(visit(elements, below, &left));
        const std::vector<Elements> cubes = each_leaf::by_cube(left, below);
        if (below > part_levels<D>(are_joined_)) {
            for (const Elements& cube : cubes) {
                in_sequence(cube, below);
            }
            return;
        }
        LookWindows windows(is_remote_);
        windows.for_each(
            std::span<const Elements>(cubes),
            [&](std::span<const Elements> next) { return look(next, below, 0); },
            [&](std::span<const Elements> window) {
                detail::in_order(
                    static_cast<std::int64_t>(window.size()), tokens_,
                    [&](std::int64_t i) {
                        return visit(window[static_cast<std::size_t>(i)], 0, nullptr);
                    },
                    [](std::int64_t /*i*/, const std::unique_ptr<Part>& part) { join(part); });
            });
    }

    void look(const Elements& elements, int coarsest, int finest) {
        if (is_remote_) {
            look(std::span<const Elements>(&elements, 1), coarsest, finest);
        }
    }
    /// Prefetches what the first of some cubes read; returns their number.
    std::size_t look(std::span<const Elements> cubes, int coarsest, int finest) {
        // No chunks are held meanwhile.
        nodes_.clear();
        const StoreLayout& layout = store_.layout();
        return look_ahead(cache_, nullptr, cubes, coarsest, finest, false, [&] {
            return [this, &layout, nodes = std::make_shared<StoreNodes>(make_nodes()),
                    left = Elements()](const Elements& cube, const LookWalk& walk,
                                       Wants& wants) mutable {
                left.clear();
                for (const Element<D>& t : cube) {
                    visitor_.look(*nodes, region_, t, walk.level, left);
                }
                for (const Element<D>& t : left) {
                    if (t.level > 0 && region_.overlap(t) != Overlap::outside) {
                        want_values(layout, t, wants);
                        asked_.for_each([&](Field field) { want_field(layout, t, field, wants); });
                    }
                }
            };
        });
    }

    const StoreReader& store_;
    const PartVisitor<D>& visitor_;
    LatticeRegion region_;
    ChunkCache cache_;
    AskedFields asked_;
    tbb::enumerable_thread_specific<StoreNodes> nodes_;
    int tokens_;
    bool is_remote_;
    bool are_joined_;
    Progress& progress_;
    std::mutex mutex_;
    VisitCounts counts_;
};

}  // namespace

template <int D>
TraverseReport traverse_parts(const Store& store, const PartVisitor<D>& visitor,
                              const TraverseOptions& options, Progress& progress) {
    const StoreReader& reader = store.reader();
    const Lattice& lattice = reader.layout().lattice();
    if (lattice.dimension() != D) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    fmt::format("the store has {} dimensions; a traversal of {} was asked for",
                                lattice.dimension(), D));
    }
    const LatticeRegion region = region_of(reader.layout().header(), lattice, options.box);
    const Budget budget = share_memory(reader, options, visitor.part_heap());
    return Workers(budget.threads).execute([&] {
        return PartsRun<D>(reader, visitor, region, budget, progress)();
    });
}

template TraverseReport traverse_parts(const Store&, const PartVisitor<1>&, const TraverseOptions&,
                                       Progress&);
template TraverseReport traverse_parts(const Store&, const PartVisitor<2>&, const TraverseOptions&,
                                       Progress&);
template TraverseReport traverse_parts(const Store&, const PartVisitor<3>&, const TraverseOptions&,
                                       Progress&);

}  // namespace detail
}  // namespace isonest
