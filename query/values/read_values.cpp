#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include <isonest/error.h>
#include <isonest/value_type.h>
#include <isonest/values.h>

#include "query/values/blocks.h"
#include "query/values/interpolation.h"
#include "query/values/label_view.h"
#include "query/values/node_fields.h"
#include "query/values/node_sampler.h"
#include "store/base/box.h"
#include "store/base/in_order.h"
#include "store/base/label_text.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/container/reader.h"

namespace isonest {
namespace detail {
namespace {

constexpr Int3 kOne{1, 1, 1};

/// The memory of a call; fewer threads are used if there is little.
struct Shares {
    int threads;
    std::uint64_t left;  ///< bytes besides what the threads hold
};

/// `each`: bytes that a thread holds.
Shares share(const StoreReader& store, std::uint64_t memory, int threads, std::uint64_t each) {
    const MemoryShare all(store.path().string(), memory, Workers::count_of(threads));
    const int count = all.threads_of(each, "this store's chunks");
    return {count, all.left() - static_cast<std::uint64_t>(count) * each};
}

/// Calls work(i) for all items, in parallel and begun in order.
template <class Work>
void for_all(const char* phase, const char* unit, std::int64_t count, int threads,
             Progress& progress, const Work& work) {
    progress.begin(phase, static_cast<std::uint64_t>(count), unit);
    Workers(threads).execute([&] {
        in_order(
            count, threads,
            [&](std::int64_t i) {
                progress.check();
                work(i);
                return i;
            },
            [&](std::int64_t, std::int64_t) { progress.advance(1); });
    });
}

/// Throws Error{invalid_argument} unless the box lies in the volume and has `count` nodes.
void require_box(const StoreReader& store, const Int3& nodes, const NodeBox& box,
                 std::size_t count) {
    for (int axis = 0; axis < 3; ++axis) {
        if (box.lo[axis] < 0 || box.size[axis] < 0 || box.size[axis] > nodes[axis] ||
            box.lo[axis] > nodes[axis] - box.size[axis]) {
            throw Error(ErrorKind::invalid_argument, {store.path().string()},
                        fmt::format("the box is not inside the level, which has {} x {} x {} nodes",
                                    nodes.x, nodes.y, nodes.z));
        }
    }
    if (count != static_cast<std::size_t>(box.size.product())) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("the box has {} nodes, but there is room for {}",
                                box.size.product(), count));
    }
}

/// Whether values of type `From` can be read as `To`. Labels of 64 bits are stored as doubles.
template <class To, class From>
bool can_hold(bool labels) {
    if (labels) {
        return std::is_same_v<To, std::int64_t>;
    }
    return std::is_same_v<To, From> || std::is_same_v<To, double> ||
           (std::is_same_v<To, std::int64_t> && std::is_integral_v<From>);
}

template <class To, class From>
To converted(From value) {
    if constexpr (std::is_same_v<To, std::int64_t> && std::is_same_v<From, double>) {
        return static_cast<std::int64_t>(label_of_value(value));
    } else {
        return static_cast<To>(value);
    }
}

/// Copies the part of a decoded chunk that is in the box.
template <class To, class From>
void copy_part(const ArrayInfo& array, const Int3& chunk, const From* data, const NodeBox& box,
               To* out) {
    const Int3 base = array.first_node(chunk);
    const Int3 from = max(base, box.lo);
    const Int3 to = min(base + array.chunk, box.lo + box.size);
    for (std::int64_t z = from.z; z < to.z; ++z) {
        for (std::int64_t y = from.y; y < to.y; ++y) {
            const Int3 at{from.x, y, z};
            const From* const first = data + array.chunk.linear(at - base);
            std::transform(first, first + (to.x - from.x), out + box.size.linear(at - box.lo),
                           [](From value) { return converted<To>(value); });
        }
    }
}

template <class To, class From>
void read_box(const StoreReader& store, const ArrayInfo& array, const NodeBox& box, To* out,
              const ReadOptions& options, Progress& progress) {
    const Shares shares = share(store, options.memory, options.threads,
                                array.chunk_bytes() + decode_heap(array.chunk_bytes()));
    const Int3 first = array.chunk_of(box.lo);
    const Int3 chunks = array.chunk_of(box.lo + box.size - kOne) - first + kOne;
    Prefetcher prefetcher(store, 0, chunks.product(),
                          [&](std::int64_t i, std::vector<WantedChunk>& wanted) {
                              wanted.push_back({&array, first + chunks.unlinear(i)});
                          });
    for_all("values", "chunks", chunks.product(), shares.threads, progress, [&](std::int64_t i) {
        prefetcher.reach(i);
        const Int3 chunk = first + chunks.unlinear(i);
        std::vector<std::byte> data(array.chunk_bytes());
        store.decode(array, chunk, data);
        copy_part(array, chunk, reinterpret_cast<const From*>(data.data()), box, out);
    });
}

/// Blocks of at most kBlockEdge^3 nodes in a box, chunk by chunk of an array.
class BoxBlocks {
  public:
    /// REQUIRES: the box is not empty.
    BoxBlocks(const ArrayInfo& array, const NodeBox& box)
        : array_(array),
          box_(box),
          first_(array.chunk_of(box.lo)),
          chunks_(array.chunk_of(box.lo + box.size - kOne) - first_ + kOne),
          in_chunk_(ceil_div(array.chunk, kOne * kBlockEdge)) {}

    [[nodiscard]] std::int64_t count() const { return chunks_.product() * in_chunk_.product(); }
    /// May be empty: a size of 0 or less along an axis.
    [[nodiscard]] NodeBox block(std::int64_t i) const {
        const Int3 chunk = array_.first_node(first_ + chunks_.unlinear(i / in_chunk_.product()));
        const Int3 in = in_chunk_.unlinear(i % in_chunk_.product()) * kBlockEdge;
        const Int3 end = chunk + min(in + kOne * kBlockEdge, array_.chunk);
        const Int3 lo = max(chunk + in, box_.lo);
        return {lo, min(end, box_.lo + box_.size) - lo};
    }

  private:
    const ArrayInfo& array_;
    NodeBox box_;
    Int3 first_;
    Int3 chunks_;
    Int3 in_chunk_;
};

bool is_empty(const NodeBox& box) {
    return std::min({box.size.x, box.size.y, box.size.z}) <= 0;
}

/// Adds the chunks that fill_indicators_at() reads for a block of nodes of a level.
void want_indicators(const StoreLayout& layout, Field field, int level, const NodeBox& block,
                     std::vector<WantedChunk>& wanted) {
    const auto add = [&](const ArrayInfo& array) {
        const std::int64_t stride = std::int64_t{1} << (array.level - level);
        const Int3 hi = block.lo + block.size - kOne;
        want_box(array, {block.lo.x / stride, block.lo.y / stride, block.lo.z / stride},
                 {hi.x / stride + 1, hi.y / stride + 1, hi.z / stride + 1}, wanted);
    };
    if (level == 0 && centre_suffices_at_level_1(field)) {
        add(layout.array(0, Field::values));
    }
    for (int l = level + 1; l <= layout.lattice().top(); ++l) {
        add(layout.array(l, field));
    }
}

// Values between nodes.

/// Points are sorted by the chunk of their cells.
struct Spot {
    std::uint64_t chunk = 0;
    std::uint64_t point = 0;
    [[nodiscard]] bool operator<(const Spot& other) const {
        return chunk != other.chunk ? chunk < other.chunk : point < other.point;
    }
};
constexpr std::uint64_t kNowhere = std::numeric_limits<std::uint64_t>::max();
constexpr std::int64_t kPointsAtOnce = 4096;

class Sampling {
  public:
    Sampling(const StoreReader& store, const SampleOptions& options,
             std::span<const Double3> points, std::span<double> values, Progress& progress)
        : array_(store.layout().array(options.level, Field::values)),
          shares_(share(store, options.memory, options.threads,
                        decode_heap(array_.chunk_bytes()) + 3 * array_.chunk_bytes() +
                            kPointsAtOnce * sizeof(Spot))),
          at_once_(
              std::clamp<std::uint64_t>(shares_.left / 4 / sizeof(Spot), kPointsAtOnce,
                                        std::max<std::uint64_t>(points.size(), kPointsAtOnce))),
          interpolation_(store.layout(), options),
          cache_(store, shares_.left - std::min(shares_.left, at_once_ * sizeof(Spot)) +
                            static_cast<std::uint64_t>(shares_.threads) * array_.chunk_bytes()),
          points_(points),
          values_(values),
          progress_(progress) {}

    void run() {
        progress_.begin("sample", points_.size(), "points");
        for (std::uint64_t begin = 0; begin < points_.size(); begin += at_once_) {
            some(begin, std::min<std::uint64_t>(at_once_, points_.size() - begin));
        }
    }
    [[nodiscard]] int threads() const { return shares_.threads; }

  private:
    void some(std::uint64_t begin, std::uint64_t count) {
        spots_.resize(count);
        tbb::parallel_for(std::uint64_t{0}, count, [&](std::uint64_t i) {
            const auto place = interpolation_.place_of(points_[begin + i]);
            spots_[i] = {place ? array_.row_of(array_.chunk_of(place->cell)) : kNowhere, begin + i};
        });
        tbb::parallel_sort(spots_.begin(), spots_.end());
        const std::int64_t groups = ceil_div(static_cast<std::int64_t>(count), kPointsAtOnce);
        Prefetcher prefetcher(
            cache_, 0, groups,
            [&](std::int64_t g, std::vector<WantedChunk>& wanted) { want(group(g), wanted); });
        in_order(
            groups, shares_.threads,
            [&](std::int64_t g) {
                progress_.check();
                prefetcher.reach(g);
                const std::span<const Spot> spots = group(g);
                NodeSampler nodes(cache_);
                for (const Spot& spot : spots) {
                    const auto place = interpolation_.place_of(points_[spot.point]);
                    values_[spot.point] = place ? interpolation_.value(nodes, *place)
                                                : std::numeric_limits<double>::quiet_NaN();
                }
                return spots.size();
            },
            [&](std::int64_t, std::size_t done) { progress_.advance(done); });
    }

    [[nodiscard]] std::span<const Spot> group(std::int64_t g) const {
        const auto first = static_cast<std::size_t>(g * kPointsAtOnce);
        return std::span(spots_).subspan(
            first, std::min<std::size_t>(kPointsAtOnce, spots_.size() - first));
    }

    /// Adds the chunks of the spots' cells.
    void want(std::span<const Spot> spots, std::vector<WantedChunk>& wanted) const {
        for (const Spot& spot : spots) {
            if (const auto place = interpolation_.place_of(points_[spot.point])) {
                const Int3 low = array_.chunk_of(place->cell);
                const Int3 high = array_.chunk_of(min(place->cell + kOne, array_.nodes - kOne));
                if (wanted.empty() || low != high || wanted.back().chunk != low) {
                    want_box(array_, place->cell, place->cell + kOne, wanted);
                }
            }
        }
    }

    const ArrayInfo& array_;
    Shares shares_;
    std::uint64_t at_once_;
    Interpolation interpolation_;
    ChunkCache cache_;
    std::span<const Double3> points_;
    std::span<double> values_;
    Progress& progress_;
    std::vector<Spot> spots_;
};

}  // namespace
}  // namespace detail

Int3 nodes_of_level(const Store& store, int level) {
    static_cast<void>(store.reader().layout().array(level, Field::values));
    return ceil_div(store.nodes(), detail::kOne * (std::int64_t{1} << level));
}

template <class T>
void read_values(const Store& store, int level, const NodeBox& box, std::span<T> values,
                 const ReadOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    detail::require_box(reader, nodes_of_level(store, level), box, values.size());
    const bool labels = reader.layout().header().labels;
    dispatch(store.type(), [&](auto tag) {
        using From = typename decltype(tag)::type;
        if (!detail::can_hold<T, From>(labels)) {
            throw Error(ErrorKind::invalid_argument, {store.path().string()},
                        fmt::format("its values are {}, which the requested type cannot hold",
                                    detail::type_of_values(reader.layout().header())));
        }
        if constexpr (std::is_same_v<T, From> || std::is_same_v<T, double> ||
                      (std::is_same_v<T, std::int64_t> && !std::is_same_v<From, float>)) {
            if (!values.empty()) {
                detail::read_box<T, From>(reader, reader.layout().array(level, Field::values), box,
                                          values.data(), options, progress);
            }
        }
    });
}

#define ISONEST_READ(tag, T)                                                      \
    template void read_values<T>(const Store&, int, const NodeBox&, std::span<T>, \
                                 const ReadOptions&, Progress&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_READ)
ISONEST_READ(labels, std::int64_t)
#undef ISONEST_READ

void read_indicator(const Store& store, Field field, int level, const NodeBox& box,
                    std::span<double> numbers, const ReadOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    const detail::StoreLayout& layout = reader.layout();
    detail::require_numbers(reader, "an indicator");
    detail::require_field_of_nodes(reader, field);
    detail::require_box(reader, nodes_of_level(store, level), box, numbers.size());
    if (numbers.empty()) {
        return;
    }
    const detail::ArrayInfo& values = layout.array(level, Field::values);
    const std::uint64_t largest = detail::largest_chunk_bytes(layout);
    // One chunk of values and one of the indicator are held, and as many are in the cache.
    const detail::Shares shares =
        detail::share(reader, options.memory, options.threads,
                      detail::kIndicatorBoxHeap + detail::decode_heap(largest) + 4 * largest);
    detail::ChunkCache cache(
        reader, shares.left + static_cast<std::uint64_t>(shares.threads) * 2 * largest);
    const detail::BoxBlocks blocks(values, box);
    detail::Prefetcher prefetcher(
        cache, 0, blocks.count(), [&](std::int64_t i, std::vector<detail::WantedChunk>& wanted) {
            if (const NodeBox block = blocks.block(i); !detail::is_empty(block)) {
                detail::want_indicators(layout, field, level, block, wanted);
            }
        });
    detail::for_all(
        "indicator", "blocks", blocks.count(), shares.threads, progress, [&](std::int64_t i) {
            const NodeBox block = blocks.block(i);
            if (detail::is_empty(block)) {
                return;
            }
            prefetcher.reach(i);
            detail::Box<double> part(block.lo, block.size);
            detail::fill_indicators_at(cache, field, level, part);
            for (std::int64_t row = 0; row < block.size.y * block.size.z; ++row) {
                const Int3 p = block.lo + Int3{0, row % block.size.y, row / block.size.y};
                std::copy_n(part.row(p.y, p.z), block.size.x,
                            numbers.data() + box.size.linear(p - box.lo));
            }
        });
}

void sample(const Store& store, std::span<const Double3> points, std::span<double> values,
            const SampleOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    detail::require_numbers(reader, "a value between nodes");
    if (points.size() != values.size()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("there are {} points, but there is room for {} values",
                                points.size(), values.size()));
    }
    if (points.empty()) {
        static_cast<void>(nodes_of_level(store, options.level));
        return;
    }
    detail::Sampling sampling(reader, options, points, values, progress);
    detail::Workers(sampling.threads()).execute([&] { sampling.run(); });
}

}  // namespace isonest
