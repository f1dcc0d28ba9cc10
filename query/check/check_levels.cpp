#include "query/check/check_levels.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "query/values/blocks.h"
#include "query/values/brick_view.h"
#include "store/container/chunk_cache.h"
#include "store/lattice/children.h"

namespace isonest::detail {
namespace {

/// Number of cubes per axis that are processed together.
constexpr std::int64_t kGroup = 8;
constexpr Int3 kOne{1, 1, 1};
/// Number of bytes of ranges that a quick check reads.
constexpr std::uint64_t kQuickBytes = std::uint64_t{256} << 20U;

/// A quick check reads every n-th plane of each level; this is n.
std::int64_t quick_stride(const StoreLayout& layout) {
    std::uint64_t bytes = 0;
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        bytes += static_cast<std::uint64_t>(layout.lattice().cells_at(level).product()) *
                 cube_range_bytes(layout.header().type);
    }
    return static_cast<std::int64_t>(bytes / kQuickBytes) + 1;
}

class RangeChecks {
  public:
    RangeChecks(const StoreReader& store, ChunkCache& cache, Findings& findings, Progress& progress,
                const RankShare& share)
        : store_(store),
          layout_(store.layout()),
          cache_(cache),
          findings_(findings),
          progress_(progress),
          share_(share) {}

    /// For a remote store, ranges of fine levels are not read.
    [[nodiscard]] bool is_read(int level) const {
        try {
            return store_.cube_range(level, {0, 0, 0}).has_value();
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            return true;  // reported by planes()
        }
    }

    /// Whether every `every`th plane is intact.
    bool planes(int level, std::int64_t every) {
        const std::int64_t all = layout_.lattice().cells_at(level).z;
        std::atomic<bool> whole = true;
        for_all("range checksums", (all + every - 1) / every, "planes", [&](std::int64_t i) {
            try {
                static_cast<void>(store_.cube_range(level, {0, 0, i * every}));
            } catch (const Error& error) {
                if (error.kind() != ErrorKind::corrupt) {
                    throw;
                }
                whole = false;
                add(level, {0, 0, i * every}, error.what());
            }
        });
        return !share_.any(!whole);
    }

    void against_values() {
        const Int3 cells = layout_.lattice().cells_at(kFirstRangeLevel);
        const Int3 groups = ceil_div(cells, kOne * kGroup);
        const auto [begin, end] = share_.of(groups.product());
        const ArrayInfo& values = layout_.array(0, Field::values);
        Prefetcher prefetcher(
            cache_, begin, end, [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                const Int3 low = groups.unlinear(i) * (kGroup * kFirstRangeEdge);
                want_box(values, low, low + kOne * (kGroup * kFirstRangeEdge), chunks);
            });
        progress_.begin("cube ranges", static_cast<std::uint64_t>(end - begin), "groups");
        for_each_prefetched(cache_.source(), prefetcher, begin, end, [&](std::int64_t i) {
            progress_.check();
            const Int3 first = groups.unlinear(i) * kGroup;
            try {
                dispatch(layout_.header().type, [&](auto tag) {
                    group<typename decltype(tag)::type>(first,
                                                        min(first + kOne * kGroup, cells) - first);
                });
            } catch (const Error& error) {
                if (error.kind() != ErrorKind::corrupt) {
                    throw;  // a damaged chunk of values is already a finding
                }
            }
            progress_.advance(1);
        });
    }

    void against_finer(int level) {
        const Int3 cells = layout_.lattice().cells_at(level);
        const Int3 finer = layout_.lattice().cells_at(level - 1);
        for_all("coarser ranges", cells.z, "planes", [&](std::int64_t z) {
            for (std::int64_t i = 0; i < cells.x * cells.y; ++i) {
                const Int3 cube{i % cells.x, i / cells.x, z};
                const Int3 count = min(cube * 2 + kOne * 2, finer) - cube * 2;
                CubeRange found;
                for (std::int64_t c = 0; c < count.product(); ++c) {
                    found.include(*store_.cube_range(level - 1, cube * 2 + count.unlinear(c)));
                }
                compare(level, cube, found);
            }
        });
    }

  private:
    template <class F>
    void for_all(const char* phase, std::int64_t count, const char* unit, const F& f) {
        const auto [first, end] = share_.of(count);
        progress_.begin(phase, static_cast<std::uint64_t>(end - first), unit);
        tbb::parallel_for(first, end, [&](std::int64_t i) {
            progress_.check();
            f(i);
            progress_.advance(1);
        });
    }

    template <class T>
    void group(const Int3& first, const Int3& count) {
        const Int3 last = layout_.lattice().nodes() - kOne;
        const Int3 end = min((first + count) * kFirstRangeEdge, last);
        Box<T> box(first * kFirstRangeEdge, end - first * kFirstRangeEdge + kOne);
        gather_values(cache_, layout_.array(0, Field::values), box);
        for (std::int64_t c = 0; c < count.product(); ++c) {
            const Int3 cube = first + count.unlinear(c);
            const Int3 n =
                min((cube + kOne) * kFirstRangeEdge, last) - cube * kFirstRangeEdge + kOne;
            double low = std::numeric_limits<double>::infinity();
            double high = -low;
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const auto value =
                    static_cast<double>(box.at(cube * kFirstRangeEdge + n.unlinear(i)));
                low = std::fmin(low, value);
                high = std::fmax(high, value);
            }
            compare(kFirstRangeLevel, cube, cube_range_around(low, high));
        }
    }

    void compare(int level, const Int3& cube, const CubeRange& found) {
        const CubeRange stored = *store_.cube_range(level, cube);
        if (stored != found) {
            add(level, cube,
                fmt::format("the store says {} to {}, the values in the cube are {} to {}",
                            stored.low, stored.high, found.low, found.high));
        }
    }

    void add(int level, const Int3& cube, const std::string& message) {
        const ArrayInfo& array = layout_.array(level, Field::values);
        findings_.add("cube range", array, array.chunk_of(cube), cube * (std::int64_t{1} << level),
                      message);
    }

    const StoreReader& store_;
    const StoreLayout& layout_;
    ChunkCache& cache_;
    Findings& findings_;
    Progress& progress_;
    RankShare share_;
};

}  // namespace

void check_cube_ranges(const StoreReader& store, ChunkCache& cache, bool quick, Findings& findings,
                       Progress& progress, const RankShare& share) {
    RangeChecks checks(store, cache, findings, progress, share);
    bool finer_whole = false;
    const std::int64_t every = quick ? quick_stride(store.layout()) : 1;
    for (int level = kFirstRangeLevel; store.layout().has_cube_ranges(level); ++level) {
        if (store.is_remote() && !checks.is_read(level)) {
            continue;
        }
        const bool whole = checks.planes(level, every);
        if (quick || !whole) {
            finer_whole = false;
            continue;
        }
        if (level == kFirstRangeLevel) {
            checks.against_values();
        } else if (finer_whole) {
            checks.against_finer(level);
        }
        finer_whole = true;
    }
}

namespace {

/// Codes near zero have fewer digits: the distance between two of them.
constexpr double kSmallestCode = decode_indicator(kCodeStep);
/// Larger numbers are rounded up to infinity.
constexpr double kLargestCode = decode_indicator(IndicatorCode{kInfinityCode - kCodeStep});

class LevelChecks {
  public:
    LevelChecks(ChunkCache& cache, Findings& findings)
        : cache_(cache), layout_(cache.source().layout()), findings_(findings) {}

    /// Checks that every node of a coarser level has the bits of the finer level's node.
    void injection(const ArrayInfo& array, const Int3& chunk) {
        if (array.level == 0) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const ArrayInfo& fine = layout_.array(array.level - 1, Field::values);
            for_each_block(
                first_of(array, chunk), count_of(array, chunk), halves(array),
                [&](const Int3& base, const Int3& n) {
                    Box<T> coarse(base, n);
                    gather_values(cache_, array, coarse);
                    Box<T> finer(base * 2, n * 2);
                    gather_values(cache_, fine, finer);
                    for (std::int64_t i = 0; i < n.product(); ++i) {
                        const Int3 p = base + n.unlinear(i);
                        // Bitwise comparison, because NaN must equal itself.
                        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
                        if (std::memcmp(&coarse.at(p), &finer.at(p * 2), sizeof(T)) != 0) {
                            findings_.add("injection", array, chunk,
                                          p * (std::int64_t{1} << array.level),
                                          "the value differs from the finer level's");
                        }
                    }
                    findings_.count(n.product());
                },
                kEdge);
        });
    }

    /// Checks that every refinement node is at least as large as its children, in this chunk and
    /// across its borders: so the stop test of a node implies that of its parents, and leaves fit
    /// together.
    void saturation(const ArrayInfo& array, const Int3& chunk) {
        const auto block = [&](const Int3& base, const Int3& n) {
            if (layout_.header().exact) {
                saturation_of_block<float>(array, chunk, base, n);
            } else {
                saturation_of_block<IndicatorCode>(array, chunk, base, n);
            }
        };
        for_each_block(first_of(array, chunk), count_of(array, chunk), halves(array), block, kEdge);
    }

    /// The same for cells: each is at least as large as all cells of the finer level that share a
    /// node with it.
    void saturation_of_cells(const ArrayInfo& array, const Int3& chunk) {
        const auto block = [&](const Int3& base, const Int3& n) {
            if (layout_.header().exact) {
                saturation_of_cell_block<float>(array, chunk, base, n);
            } else {
                saturation_of_cell_block<IndicatorCode>(array, chunk, base, n);
            }
        };
        for_each_block(first_of(array, chunk), count_of(array, chunk), halves(array), block, kEdge);
    }

  private:
    /// Edge of the blocks of a chunk; small, so that little data is gathered at a time.
    static constexpr std::int64_t kEdge = 16;
    static Int3 first_of(const ArrayInfo& array, const Int3& chunk) {
        return array.first_node(chunk);
    }
    static Int3 count_of(const ArrayInfo& array, const Int3& chunk) {
        return min(array.chunk, array.nodes - array.first_node(chunk));
    }
    /// The part of a chunk that is covered by one chunk of the finer level.
    static Int3 halves(const ArrayInfo& array) { return ceil_div(array.chunk, {2, 2, 2}); }
    static double value_of(float value) { return static_cast<double>(value); }
    static double value_of(IndicatorCode code) {
        return static_cast<double>(decode_indicator(code));
    }

    /// Some components of the nodes in a box.
    template <class T>
    struct Gathered {
        Int3 lo;
        Int3 size;
        int components = 0;
        std::vector<T> data;
        [[nodiscard]] double at(const Int3& p, int component) const {
            return value_of(
                data[static_cast<std::size_t>(size.linear(p - lo) * components + component)]);
        }
    };
    /// Gathers from `lo` up to `end`, as far as nodes exist.
    template <class T>
    Gathered<T> gather(const ArrayInfo& array, const Int3& lo, const Int3& end, int first,
                       int count) {
        Gathered<T> g{max(lo, {0, 0, 0}), {}, count, {}};
        g.size = min(end, array.nodes) - g.lo;
        g.data = gather_components<T>(cache_, array, g.lo, g.size, first, count);
        return g;
    }

    /// Checks the `n` nodes starting at `base`.
    template <class T>
    void saturation_of_block(const ArrayInfo& array, const Int3& chunk, const Int3& base,
                             const Int3& n) {
        const Int3 cells = layout_.lattice().cells_at(array.level);
        const Int3 finer_cells = layout_.lattice().elements_at(array.level - 1);
        const auto exists = [&](const Int3& p) {
            return min(p, {0, 0, 0}) == Int3{0, 0, 0} && max(p, cells * 2) == cells * 2;
        };
        constexpr Int3 kUnit{1, 1, 1};
        const auto own = gather<T>(array, base, base + n + kUnit, 0, array.components);
        Gathered<T> finer;
        const bool has_finer = array.level > 1;
        if (has_finer) {
            const ArrayInfo& fine = layout_.array(array.level - 1, array.field);
            finer = gather<T>(fine, base * 2 - kUnit, (base + n) * 2 + kUnit,
                              layout_.lattice().centre_slot() - fine.first_slot, 1);
        }
        std::int64_t compared = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 node = base + n.unlinear(i);
            for (int slot = 0; slot < array.components; ++slot) {
                const Int3 o = slot_offset(slot);
                const Int3 p = node * 2 + o;
                if (!exists(p)) {
                    continue;
                }
                const double value = own.at(node, slot);
                const auto against = [&](double child, const Int3& at, std::int64_t scale) {
                    ++compared;
                    if (!(value >= child)) {
                        findings_.add("saturation", array, chunk,
                                      p * (std::int64_t{1} << (array.level - 1)),
                                      fmt::format("{} is less than {} at its child {} {} {}", value,
                                                  child, at.x * scale, at.y * scale, at.z * scale));
                    }
                };
                const auto odd = static_cast<unsigned>(slot + 1);
                const std::int64_t scale = std::int64_t{1} << (array.level - 1);
                for (const Int3& offset : child_offsets(odd, layout_.lattice().flat_axes())) {
                    if (std::popcount(odd) > 1) {
                        const Int3 c = p + offset;
                        against(own.at({c.x >> 1, c.y >> 1, c.z >> 1}, slot_of(c)), c, scale);
                    } else if (has_finer) {
                        const Int3 c = p * 2 + offset;
                        const Int3 cube{c.x >> 1, c.y >> 1, c.z >> 1};
                        if (min(cube, {0, 0, 0}) == Int3{0, 0, 0} &&
                            max(cube + kUnit, finer_cells) == finer_cells) {
                            against(finer.at(cube, 0), c, scale / 2);
                        }
                    }
                }
            }
        }
        findings_.count(compared);
    }

    template <class T>
    void saturation_of_cell_block(const ArrayInfo& array, const Int3& chunk, const Int3& base,
                                  const Int3& n) {
        if (array.level == 1) {
            return;
        }
        const Int3 cells = layout_.lattice().elements_at(array.level);
        const Int3 finer_cells = layout_.lattice().elements_at(array.level - 1);
        const Int3 two{2, 2, 2};
        const Int3 one{1, 1, 1};
        const auto own = gather<T>(array, base, base + n, 0, 1);
        const auto finer = gather<T>(layout_.array(array.level - 1, array.field), base * 2 - one,
                                     (base + n) * 2 + one, 0, 1);
        std::int64_t compared = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 cell = base + n.unlinear(i);
            if (max(cell + one, cells) != cells) {
                continue;
            }
            const Int3 first = max(cell * 2 - one, {0, 0, 0});
            const Int3 count = min(cell * 2 + two + one, finer_cells) - first;
            for (std::int64_t c = 0; c < count.product(); ++c) {
                const Int3 at = first + count.unlinear(c);
                ++compared;
                if (!(own.at(cell, 0) >= finer.at(at, 0))) {
                    findings_.add("saturation", array, chunk,
                                  cell * (std::int64_t{1} << array.level),
                                  fmt::format("{} is less than {}, the value at its neighbour or "
                                              "child ({}, {}, {}) of level {}",
                                              own.at(cell, 0), finer.at(at, 0), at.x, at.y, at.z,
                                              array.level - 1));
                }
            }
        }
        findings_.count(compared);
    }

  public:
    /// Level 1: compares the stored centre of each cube with the indicators of its 19 nodes,
    /// computed from the values: it must never be below, and at most the codes' rounding above.
    void finest_bounds(const ArrayInfo& array, const Int3& chunk) {
        const Int3 first = array.first_node(chunk);
        const Int3 all = min(array.chunk, layout_.lattice().elements_at(1) - first);
        if (min(all, {1, 1, 1}) != Int3{1, 1, 1}) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            for_each_block(
                first, all, array.chunk,
                [&](const Int3& base, const Int3& n) {
                    Box<T> values(base * 2, n * 2 + Int3{1, 1, 1});
                    gather_values(cache_, layout_.array(0, Field::values), values);
                    IndicatorView own(cache_, array, first);
                    for (std::int64_t i = 0; i < n.product(); ++i) {
                        const Int3 cube = base + n.unlinear(i);
                        const double stored = own.at(cube - first, array.first_slot);
                        const double computed = finest_indicator(
                            cube_values(values, cube), position_of_slot(array.first_slot),
                            saturation_of(array.field) == Saturation::plus,
                            layout_.rounds_outward());
                        const bool tight = stored <= computed * (1 + kCodeExcess) + kSmallestCode ||
                                           computed > kLargestCode;
                        if (!(stored >= computed) || !tight) {
                            findings_.add("indicator", array, chunk,
                                          cube * 2 + slot_offset(array.first_slot),
                                          fmt::format("{} is stored, {} follows from the values",
                                                      stored, computed));
                        }
                    }
                    findings_.count(n.product());
                },
                kEdge);
        });
    }

  private:
    ChunkCache& cache_;
    const StoreLayout& layout_;
    Findings& findings_;
};

}  // namespace

void check_levels(ChunkCache& cache, Findings& findings, const ArrayInfo& array,
                  const Int3& chunk) {
    LevelChecks checks(cache, findings);
    if (array.field == Field::values) {
        checks.injection(array, chunk);
    } else if (is_of_cells(array.field)) {
        checks.saturation_of_cells(array, chunk);
    } else if (array.level == 1 && centre_suffices_at_level_1(array.field)) {
        checks.finest_bounds(array, chunk);
    } else {
        checks.saturation(array, chunk);
    }
}

}  // namespace isonest::detail
