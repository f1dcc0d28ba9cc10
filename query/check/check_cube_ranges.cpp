#include "query/check/check_cube_ranges.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <atomic>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "store/container/announce/announcer.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

/// Cubes per axis that are looked at together.
constexpr std::int64_t kGroup = 8;
constexpr Int3 kOne{1, 1, 1};
/// How many bytes of ranges a quick check reads.
constexpr std::uint64_t kQuickBytes = std::uint64_t{256} << 20U;

/// A quick check looks at every so-manieth plane of each level.
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

    /// Of a store that is far, ranges of fine levels are not read.
    [[nodiscard]] bool is_read(int level) const {
        try {
            return store_.cube_range(level, {0, 0, 0}).has_value();
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            return true;  // planes() says so
        }
    }

    /// Whether every `every`th plane is whole.
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
        Announcer announcer(
            cache_, begin, end, [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                const Int3 low = groups.unlinear(i) * (kGroup * kFirstRangeEdge);
                want_box(values, low, low + kOne * (kGroup * kFirstRangeEdge), chunks);
            });
        progress_.begin("cube ranges", static_cast<std::uint64_t>(end - begin), "groups");
        for_each_announced(cache_.source(), announcer, begin, end, [&](std::int64_t i) {
            progress_.check();
            const Int3 first = groups.unlinear(i) * kGroup;
            try {
                dispatch(layout_.header().type, [&](auto tag) {
                    group<typename decltype(tag)::type>(first,
                                                        min(first + kOne * kGroup, cells) - first);
                });
            } catch (const Error& error) {
                if (error.kind() != ErrorKind::corrupt) {
                    throw;  // a damaged chunk of values is a finding already
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
        if (store.is_far() && !checks.is_read(level)) {
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

}  // namespace isonest::detail
