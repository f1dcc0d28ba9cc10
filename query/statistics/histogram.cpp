#include "query/statistics/histogram.h"

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>

#include "query/statistics/value_counts.h"
#include "store/base/in_order.h"
#include "store/base/label_bits.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/announce/announcer.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

constexpr Int3 kOne{1, 1, 1};

Int3 nodes_in_volume(const Lattice& lattice, int level) {
    return ceil_div(lattice.nodes(), kOne * (std::int64_t{1} << level));
}

int level_for(const Lattice& lattice) {
    int level = 0;
    while (nodes_in_volume(lattice, level).product() > kMostHistogramNodes) {
        ++level;
    }
    return level;
}

/// How the memory is shared; fewer threads run where there is little.
struct Shares {
    int threads;
    std::uint64_t cache;
};

Shares share(const StoreReader& store, const ArrayInfo& array, const HistogramOptions& options) {
    const std::uint64_t chunk = array.chunk_bytes();
    const auto box = static_cast<std::uint64_t>((array.chunk + kOne).product()) *
                     (array.codec.element_size + sizeof(BinCode));
    // One chunk is decoded by itself or held, two are in the cache besides.
    const std::uint64_t each = decode_heap(chunk) + 3 * chunk + box;
    require_memory(store.path().string(), options.memory, kLibraryHeap + each,
                   "this store's chunks");
    const std::uint64_t usable = options.memory - kLibraryHeap;
    const auto threads = std::clamp<std::uint64_t>(
        usable / each, 1, static_cast<std::uint64_t>(Workers::count_of(options.threads)));
    return {static_cast<int>(threads), usable - threads * (each - 3 * chunk)};
}

class Counting {
  public:
    /// `own_cubes`: they are counted with the nodes. `first_label`: see Histogram.
    Counting(const StoreReader& store, const ArrayInfo& array, bool own_cubes,
             const ValueBins& bins, std::optional<std::int64_t> first_label, const Shares& shares,
             Progress& progress)
        : store_(store),
          array_(array),
          own_cubes_(own_cubes),
          bins_(bins),
          first_label_(first_label),
          shares_(shares),
          progress_(progress),
          counts_(bins.count()) {}

    void values() {
        ChunkCache cache(store_, shares_.cache);
        Announcer announcer(store_, 0, array_.grid.product(),
                            [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                                chunks.push_back({&array_, array_.grid.unlinear(i)});
                            });
        for_all("histogram", array_.grid.product(), "chunks", [&](std::int64_t i) {
            announcer.reach(std::min(last_needed(i), array_.grid.product() - 1));
            dispatch(store_.layout().header().type, [&](auto tag) {
                block<typename decltype(tag)::type>(cache, array_.grid.unlinear(i));
            });
        });
    }

    void ranges(int level) {
        const Int3 cubes = store_.layout().lattice().cells_at(level);
        if (bins_.count() > 0) {
            store_.prefetch_cube_ranges(level);
        }
        for_all("cube ranges", bins_.count() > 0 ? cubes.z : 0, "planes", [&](std::int64_t z) {
            const BinFinder bin_of(bins_);
            for (const CubeRange& range : store_.cube_ranges(level, z)) {
                if (range.low <= range.high) {
                    counts_.local().add_cube(bin_of(static_cast<double>(range.low)),
                                             bin_of(static_cast<double>(range.high)));
                }
            }
        });
    }

    ValueCounts sum() {
        ValueCounts all(bins_.count());
        counts_.combine_each([&](const ValueCounts& counts) { all.add(counts); });
        return all;
    }

  private:
    /// The last chunk in order of those that a block reaches into.
    [[nodiscard]] std::int64_t last_needed(std::int64_t i) const {
        const Int3& grid = array_.grid;
        return !own_cubes_ ? i : i + 1 + grid.x + grid.x * grid.y;
    }
    /// In order, so that neighbours are still in the cache.
    template <class F>
    void for_all(const char* phase, std::int64_t count, const char* unit, const F& f) {
        progress_.begin(phase, static_cast<std::uint64_t>(count), unit);
        const auto compute = [&](std::int64_t i) {
            progress_.check();
            f(i);
            return i;
        };
        in_order(count, shares_.threads, compute,
                 [&](std::int64_t /*i*/, std::int64_t /*same*/) { progress_.advance(1); });
    }

    /// What the bins are of.
    [[nodiscard]] double number_of(double value) const {
        return first_label_ ? static_cast<double>(static_cast<std::int64_t>(label_of_value(value)) -
                                                  *first_label_)
                            : value;
    }

    /// The nodes of a chunk, and of the finest level the cubes that begin in it.
    template <class T>
    void block(ChunkCache& cache, const Int3& chunk) {
        const Int3 first = array_.first_node(chunk);
        const Int3 nodes = nodes_in_volume(store_.layout().lattice(), array_.level);
        const Int3 own = max(min(array_.chunk, nodes - first), {0, 0, 0});
        const Int3 size = own_cubes_ ? min(own + kOne, nodes - first) : own;
        if (size.product() == 0) {
            return;  // beyond the volume
        }
        Box<T> values(first, size);
        gather_values(cache, array_, values);
        Box<BinCode> codes(first, size);
        if (bins_.count() > 0) {
            const BinFinder bin_of(bins_);
            std::transform(values.data.begin(), values.data.end(), codes.data.begin(), [&](T v) {
                const double value = number_of(static_cast<double>(v));
                return std::isfinite(value) ? static_cast<BinCode>(bin_of(value) + 1)
                                            : kMissingCode;
            });
        }
        ValueCounts& counts = counts_.local();
        counts.add_nodes(codes, own);
        if (own_cubes_) {
            // None begins in the last node; along a flat axis they have no extent.
            Int3 cells = size - kOne;
            for (int axis = 0; axis < 3; ++axis) {
                cells[axis] = nodes[axis] == 1 ? 1 : cells[axis];
            }
            counts.add_cubes(codes, cells);
        }
    }

    const StoreReader& store_;
    const ArrayInfo& array_;
    bool own_cubes_;
    const ValueBins& bins_;
    std::optional<std::int64_t> first_label_;
    const Shares& shares_;
    Progress& progress_;
    tbb::enumerable_thread_specific<ValueCounts> counts_;
};

}  // namespace

Histogram histogram(const StoreReader& store, const HistogramOptions& options, Progress& progress) {
    const StoreLayout& layout = store.layout();
    const int level = options.level ? *options.level : level_for(layout.lattice());
    const ArrayInfo& array = layout.array(level, Field::values);
    const bool labels = layout.header().labels && store.min_value() <= store.max_value();
    std::optional<std::int64_t> first_label;
    ValueBins bins(layout.header().type, store.min_value(), store.max_value());
    if (labels) {
        const std::uint64_t first = label_of_value(store.min_value());
        first_label = static_cast<std::int64_t>(first);
        bins = ValueBins(ValueType::u32, 0,
                         static_cast<double>(label_of_value(store.max_value()) - first));
    }
    const Shares shares = share(store, array, options);
    const bool own_cubes = !labels && (level == 0 || options.own_cubes);
    std::optional<int> cube_level;
    if (labels) {
        // No surface passes between labels at a value.
    } else if (own_cubes || layout.has_cube_ranges(kFirstRangeLevel)) {
        cube_level = own_cubes ? level : kFirstRangeLevel;
    }
    Counting counting(store, array, own_cubes, bins, first_label, shares, progress);
    Workers(shares.threads).execute([&] {
        counting.values();
        if (!own_cubes && cube_level) {
            counting.ranges(*cube_level);
        }
    });
    const ValueCounts counts = counting.sum();
    Histogram result;
    result.dimension = layout.lattice().dimension();
    result.level = level;
    result.looked = static_cast<std::uint64_t>(nodes_in_volume(layout.lattice(), level).product());
    result.missing = counts.missing();
    result.bins = bins;
    result.first_label = first_label;
    result.nodes = counts.nodes();
    result.cube_level = cube_level;
    if (cube_level) {
        result.cubes = counts.cubes();
        result.suggested = suggest_isovalues(bins, result.nodes, result.cubes);
    }
    return result;
}

}  // namespace isonest::detail
