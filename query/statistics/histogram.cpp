#include "query/statistics/histogram.h"

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "store/base/in_order.h"
#include "store/base/label_text.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

BinFinder::BinFinder(const ValueBins& bins)
    : bins_(&bins), first_(bins.low.front()), last_(bins.count() - 1) {
    per_half_ = bins.integer ? bins.count() / (bins.end - first_)
                             : bins.count() / (bins.end / 2 - first_ / 2);
}

void ValueCounts::add_nodes(const Box<BinCode>& box, const Int3& own) {
    for (std::int64_t z = 0; z < own.z; ++z) {
        for (std::int64_t y = 0; y < own.y; ++y) {
            const BinCode* const row = box.row(box.lo.y + y, box.lo.z + z);
            for (std::int64_t x = 0; x < own.x; ++x) {
                ++nodes_[row[x]];
            }
        }
    }
}

void ValueCounts::add_cubes(const Box<BinCode>& box, const Int3& cells) {
    // A code minus 1, modulo 2^16, is the bin; for a missing value it is larger than any bin.
    constexpr auto kNone = std::numeric_limits<BinCode>::max();
    const auto bin = [](BinCode code) { return static_cast<BinCode>(code - 1U); };
    const Int3 step = min(box.size - Int3{1, 1, 1}, {1, 1, 1});
    const auto row_nodes = static_cast<std::size_t>(box.size.x);
    std::vector<BinCode> low(row_nodes);
    std::vector<BinCode> high(row_nodes);
    for (std::int64_t z = 0; z < cells.z; ++z) {
        for (std::int64_t y = 0; y < cells.y; ++y) {
            const BinCode* const a = box.row(box.lo.y + y, box.lo.z + z);
            const BinCode* const b = box.row(box.lo.y + y + step.y, box.lo.z + z);
            const BinCode* const c = box.row(box.lo.y + y, box.lo.z + z + step.z);
            const BinCode* const d = box.row(box.lo.y + y + step.y, box.lo.z + z + step.z);
            for (std::size_t x = 0; x < row_nodes; ++x) {
                const BinCode low_ab = std::min(bin(a[x]), bin(b[x]));
                const BinCode low_cd = std::min(bin(c[x]), bin(d[x]));
                low[x] = std::min(low_ab, low_cd);
                const BinCode high_ab = std::max(a[x], b[x]);
                const BinCode high_cd = std::max(c[x], d[x]);
                high[x] = std::max(high_ab, high_cd);
            }
            for (std::int64_t x = 0; x < cells.x; ++x) {
                const auto i = static_cast<std::size_t>(x);
                const auto j = static_cast<std::size_t>(x + step.x);
                const BinCode least = std::min(low[i], low[j]);
                const BinCode most = std::max(high[i], high[j]);
                if (least != kNone) {
                    add_cube(least, most - 1);
                }
            }
        }
    }
}

void ValueCounts::add(const ValueCounts& other) {
    const auto plus = std::plus<>();
    std::transform(nodes_.begin(), nodes_.end(), other.nodes_.begin(), nodes_.begin(), plus);
    std::transform(changes_.begin(), changes_.end(), other.changes_.begin(), changes_.begin(),
                   plus);
}

std::vector<std::uint64_t> ValueCounts::cubes() const {
    std::vector<std::uint64_t> cubes(changes_.size() - 1);
    std::partial_sum(changes_.begin(), changes_.end() - 1, cubes.begin());
    return cubes;
}

namespace {

constexpr std::uint64_t kFewestNodes = 64;
constexpr std::uint64_t kMinNodes = 65536;  ///< one in so many
constexpr std::uint64_t kMinSurface = 100;  ///< one in so many
constexpr std::size_t kWindow = 32;         ///< one in so many
constexpr double kProminence = 1.5;
constexpr std::size_t kMaxSuggested = 5;

/// Some neighbouring bins.
struct Group {
    std::size_t middle = 0;  ///< the bin whose smallest value is the isovalue
    double nodes = 0;
    double cubes = 0;
};

/// The ratio of the curve at i to the lowest point on the way to a higher one, the smaller one of
/// both directions; infinite if none is higher. Of equal heights the first counts as the higher
/// one.
double prominence(const std::vector<double>& curve, std::size_t i) {
    double least = std::numeric_limits<double>::infinity();
    double valley = curve[i];
    for (std::size_t j = i; j-- > 0;) {
        if (curve[j] >= curve[i]) {
            least = curve[i] / valley;
            break;
        }
        valley = std::min(valley, curve[j]);
    }
    valley = curve[i];
    for (std::size_t j = i + 1; j < curve.size(); ++j) {
        if (curve[j] > curve[i]) {
            return std::min(least, curve[i] / valley);
        }
        valley = std::min(valley, curve[j]);
    }
    return least;
}

std::vector<Group> groups_of(std::span<const std::uint64_t> nodes,
                             std::span<const std::uint64_t> cubes) {
    const std::uint64_t all = std::accumulate(nodes.begin(), nodes.end(), std::uint64_t{0});
    const std::uint64_t largest = *std::max_element(cubes.begin(), cubes.end());
    const std::uint64_t enough = std::max(kFewestNodes, all / kMinNodes);
    std::vector<Group> groups;
    for (std::size_t begin = 0; begin < nodes.size();) {
        std::uint64_t sum = 0;
        std::size_t end = begin;
        while (end < nodes.size() && sum < enough) {
            sum += nodes[end++];
        }
        if (sum < enough) {
            break;  // too few are left
        }
        Group group;
        group.middle = std::clamp<std::size_t>((begin + end) / 2, 1, nodes.size() - 1);
        group.nodes = static_cast<double>(sum);
        for (std::size_t k = begin; k < end; ++k) {
            const std::uint64_t above = k + 1 < cubes.size() ? cubes[k + 1] : 0;
            group.cubes += (static_cast<double>(cubes[k]) + static_cast<double>(above)) / 2;
        }
        if (cubes[group.middle] >= largest / kMinSurface && cubes[group.middle] > 0) {
            groups.push_back(group);
        }
        begin = end;
    }
    return groups;
}

}  // namespace

std::vector<SuggestedIsovalue> suggest_isovalues(const ValueBins& bins,
                                                 std::span<const std::uint64_t> nodes,
                                                 std::span<const std::uint64_t> cubes) {
    if (bins.count() < 2) {
        return {};
    }
    const std::vector<Group> groups = groups_of(nodes, cubes);
    const std::size_t reach = groups.size() / kWindow;
    std::vector<double> curve;
    for (std::size_t i = 0; i < groups.size(); ++i) {
        Group sum;
        for (std::size_t j = i - std::min(i, reach); j < std::min(i + reach + 1, groups.size());
             ++j) {
            sum.nodes += groups[j].nodes;
            sum.cubes += groups[j].cubes;
        }
        curve.push_back(sum.cubes / sum.nodes);
    }
    struct Peak {
        double prominence;
        std::size_t middle;
    };
    std::vector<Peak> peaks;
    for (std::size_t i = 0; i < groups.size(); ++i) {
        const double height = prominence(curve, i);
        if (height >= kProminence) {
            peaks.push_back({height, groups[i].middle});
        }
    }
    std::stable_sort(peaks.begin(), peaks.end(),
                     [](const Peak& a, const Peak& b) { return a.prominence > b.prominence; });
    peaks.resize(std::min(peaks.size(), kMaxSuggested));
    std::vector<SuggestedIsovalue> suggested;
    suggested.reserve(peaks.size());
    for (const Peak& peak : peaks) {
        // There is no integer in between: the cubes are the same, and the surface passes through no
        // node.
        suggested.push_back({bins.low[peak.middle] - (bins.integer ? 0.5 : 0), cubes[peak.middle]});
    }
    return suggested;
}

namespace {

constexpr Int3 kOne{1, 1, 1};

Int3 nodes_in_volume(const Lattice& lattice, int level) {
    return ceil_div(lattice.nodes(), kOne * (std::int64_t{1} << level));
}

int level_for(const Lattice& lattice) {
    int level = 0;
    while (nodes_in_volume(lattice, level).product() > kMaxHistogramNodes) {
        ++level;
    }
    return level;
}

/// Distribution of the memory; fewer threads are used if there is little.
struct Shares {
    int threads;
    std::uint64_t cache;
};

Shares share(const StoreReader& store, const ArrayInfo& array, const HistogramOptions& options) {
    const std::uint64_t chunk = array.chunk_bytes();
    const auto box = static_cast<std::uint64_t>((array.chunk + kOne).product()) *
                     (array.codec.element_size + sizeof(BinCode));
    // One chunk is decoded directly or held, two more are in the cache.
    const std::uint64_t each = decode_heap(chunk) + 3 * chunk + box;
    const MemoryShare memory(store.path().string(), options.memory,
                             Workers::count_of(options.threads));
    const int threads = memory.threads_of(each, "this store's chunks");
    return {threads, memory.left() - static_cast<std::uint64_t>(threads) * (each - 3 * chunk)};
}

class Counting {
  public:
    /// `own_cubes`: count cubes between the nodes. `first_label`: see Histogram.
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
        Prefetcher prefetcher(store_, 0, array_.grid.product(),
                              [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                                  chunks.push_back({&array_, array_.grid.unlinear(i)});
                              });
        for_all("histogram", array_.grid.product(), "chunks", [&](std::int64_t i) {
            prefetcher.reach(std::min(last_needed(i), array_.grid.product() - 1));
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
    /// The last chunk, in order, that a block uses.
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

    /// The number that is assigned to a bin.
    [[nodiscard]] double number_of(double value) const {
        return first_label_ ? static_cast<double>(static_cast<std::int64_t>(label_of_value(value)) -
                                                  *first_label_)
                            : value;
    }

    /// Counts the nodes of a chunk and, at the finest level, the cubes that start in it.
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
            // No cube starts at the last node; along a flat axis cubes have no extent.
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
        // Values are multiples of the step, and an isovalue at one of them would touch plateaus.
        if (const double step = layout.header().rounding.step; step > 0) {
            for (SuggestedIsovalue& suggested : result.suggested) {
                suggested.isovalue = (std::floor(suggested.isovalue / step) + 0.5) * step;
            }
        }
    }
    return result;
}

}  // namespace isonest::detail

namespace isonest {

ValueBins::ValueBins(ValueType type, double lowest, double highest)
    : end(highest), integer(type != ValueType::f32 && type != ValueType::f64) {
    if (!(lowest <= highest)) {
        return;
    }
    if (integer) {
        const double numbers = highest - lowest + 1;
        const double width = std::ceil(numbers / detail::kMaxBins);
        const auto count = static_cast<int>(std::ceil(numbers / width));
        for (int k = 0; k < count; ++k) {
            low.push_back(lowest + k * width);
        }
        end = low.back() + width;
        return;
    }
    const int count = lowest < highest ? detail::kMaxBins : 1;
    for (int k = 0; k < count; ++k) {
        // Ascending, and finite even if the difference of the ends is not.
        low.push_back(std::lerp(lowest, highest, static_cast<double>(k) / count));
    }
}

Histogram histogram(const Store& store, const HistogramOptions& options, Progress& progress) {
    return detail::histogram(store.reader(), options, progress);
}

}  // namespace isonest
