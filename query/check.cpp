#include "query/check.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <set>

#include "query/brick_view.h"
#include "query/brute_force.h"
#include "query/finest_indicators.h"
#include "store/error.h"
#include "store/gather.h"
#include "store/workers.h"

namespace isonest {
namespace {

constexpr Int3 kWholeChunk{-1, -1, -1};
/// Codes near zero have fewer digits: the distance between two of them.
constexpr double kSmallestCode = 0x1p-133;

class Checker {
  public:
    Checker(const StoreReader& store, const CheckOptions& options, Progress& progress)
        : store_(store),
          layout_(store.layout()),
          options_(options),
          progress_(progress),
          cache_(store, options.memory / 2) {}

    CheckReport run() {
        for_each_chunk("checksums", [&](const ArrayInfo& a, const Int3& c) { stored(a, c); });
        if (!options_.quick) {
            for_each_chunk("decode", [&](const ArrayInfo& a, const Int3& c) { decoded(a, c); });
            for_each_chunk("levels", [&](const ArrayInfo& a, const Int3& c) {
                if (a.field == Field::values) {
                    injection(a, c);
                } else if (a.level == 1 && centre_suffices_at_level_1(a.field)) {
                    finest_bounds(a, c);
                } else {
                    saturation(a, c);
                }
            });
        }
        if (options_.source) {
            source_values();
            dispatch(layout_.header().type,
                     [&](auto tag) { sampled_bounds<typename decltype(tag)::type>(); });
        }
        return std::move(report_);
    }

  private:
    void add(const char* test, const ArrayInfo& array, const Int3& chunk, const Int3& node,
             const std::string& message) {
        const std::lock_guard lock(mutex_);
        ++report_.failures;
        if (report_.findings.size() < 100) {
            report_.findings.push_back(
                {test, std::string(name_of(array.field)), array.level, chunk, node, message});
        }
    }
    void count_nodes(std::int64_t n) {
        const std::lock_guard lock(mutex_);
        report_.nodes += static_cast<std::uint64_t>(n);
    }
    bool damaged(const ArrayInfo& array, const Int3& chunk) {
        const std::lock_guard lock(mutex_);
        return damaged_.contains(array.row_of(chunk));
    }

    template <class F>
    void for_each_chunk(const char* phase, F&& f) {
        progress_.begin(phase, layout_.rows(), "chunks");
        for (const ArrayInfo& array : layout_.arrays()) {
            if (array.alias) {
                continue;
            }
            tbb::parallel_for(std::int64_t{0}, array.grid.product(), [&](std::int64_t i) {
                progress_.check();
                const Int3 chunk = array.grid.unlinear(i);
                try {
                    if (!damaged(array, chunk)) {
                        f(array, chunk);
                    }
                } catch (const Error& error) {
                    if (error.kind() != ErrorKind::corrupt) {
                        throw;
                    }
                    // A neighbour is damaged and has its own finding; this chunk's is made once.
                    fail_chunk(array, chunk, error.what());
                }
                progress_.advance(1);
            });
        }
    }
    void fail_chunk(const ArrayInfo& array, const Int3& chunk, const std::string& message) {
        {
            const std::lock_guard lock(mutex_);
            if (!damaged_.empty()) {
                const bool known = damaged_.contains(array.row_of(chunk));
                if (known) {
                    return;
                }
            }
            damaged_.insert(array.row_of(chunk));
        }
        add("decode", array, chunk, kWholeChunk, message);
    }

    void stored(const ArrayInfo& array, const Int3& chunk) {
        {
            const std::lock_guard lock(mutex_);
            ++report_.chunks;
        }
        const ChunkRow row = store_.row(array, chunk);
        if ((row.flags & ~kChunkHasMissing) != 0) {
            add("table", array, chunk, kWholeChunk, "reserved flags are set");
        }
        if (checksum_of(store_.stored(array, chunk)) != row.checksum) {
            {
                const std::lock_guard lock(mutex_);
                damaged_.insert(array.row_of(chunk));
            }
            add("checksum", array, chunk, kWholeChunk,
                "the stored bytes are not those that were written; restore the store from a good "
                "copy");
        }
    }

    void decoded(const ArrayInfo& array, const Int3& chunk) {
        std::vector<std::byte> raw(array.chunk_bytes());
        store_.decode(array, chunk, raw);
        double low = std::numeric_limits<double>::infinity();
        double high = array.field == Field::values ? -low : 0;
        bool missing = false;
        const auto see = [&](double v) {
            if (array.field == Field::values && !std::isfinite(v)) {
                missing = true;
                return;
            }
            low = std::fmin(low, v);
            high = std::fmax(high, v);
        };
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, array.nodes - base);
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const std::int64_t at = array.chunk.linear(n.unlinear(i)) * array.components;
            for (int c = 0; c < array.components; ++c) {
                see(element(array, raw, static_cast<std::size_t>(at + c)));
            }
        }
        count_nodes(n.product() * array.components);
        const ChunkRow row = store_.row(array, chunk);
        if (row.min != low || row.max != high || ((row.flags & kChunkHasMissing) != 0) != missing) {
            add("range", array, chunk, kWholeChunk,
                fmt::format("the table says {} to {}, the chunk holds {} to {}", row.min, row.max,
                            low, high));
        }
    }

    [[nodiscard]] double element(const ArrayInfo& array, const std::vector<std::byte>& raw,
                                 std::size_t i) const {
        if (array.field == Field::values) {
            return dispatch(layout_.header().type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                return static_cast<double>(reinterpret_cast<const T*>(raw.data())[i]);
            });
        }
        return layout_.header().exact
                   ? static_cast<double>(reinterpret_cast<const float*>(raw.data())[i])
                   : static_cast<double>(
                         decode_indicator(reinterpret_cast<const IndicatorCode*>(raw.data())[i]));
    }

    /// Every node of a coarser level has the bits of the finer level's node.
    void injection(const ArrayInfo& array, const Int3& chunk) {
        if (array.level == 0) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const ArrayInfo& fine = layout_.array(array.level - 1, Field::values);
            const Int3 base = array.first_node(chunk);
            const Int3 n = min(array.chunk, array.nodes - base);
            Box<T> coarse(base, n);
            gather_values(cache_, array, coarse);
            Box<T> finer(base * 2, n * 2);
            gather_values(cache_, fine, finer);
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const Int3 p = base + n.unlinear(i);
                if (std::memcmp(&coarse.at(p), &finer.at(p * 2), sizeof(T)) != 0) {
                    add("injection", array, chunk, p * (std::int64_t{1} << array.level),
                        "the value differs from the finer level's");
                }
            }
            count_nodes(n.product());
        });
    }

    /// Every refinement node is at least its children, in this chunk and across its borders: so the
    /// stop test of a node implies that of its parents, and leaves fit together.
    void saturation(const ArrayInfo& array, const Int3& chunk) {
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, array.nodes - base);
        const Int3 cells = layout_.lattice().cells_at(array.level);
        const auto exists = [&](const Int3& p) {
            return min(p, {0, 0, 0}) == Int3{0, 0, 0} && max(p, cells * 2) == cells * 2;
        };
        IndicatorView own(cache_, array, base);
        std::array<IndicatorView, 27> finer;
        const ArrayInfo* fine = nullptr;
        if (array.level > 1) {
            fine = &layout_.array(array.level - 1, array.field);
            for (std::size_t i = 0; i < 27; ++i) {
                const Int3 o =
                    (Int3{3, 3, 3}).unlinear(static_cast<std::int64_t>(i)) - Int3{1, 1, 1};
                finer[i] = IndicatorView(cache_, *fine, base * 2 + fine->first_node(o) * 2);
            }
        }
        std::int64_t compared = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 node = n.unlinear(i);
            for (int slot = 0; slot < array.components; ++slot) {
                const Int3 o = slot_offset(slot);
                const Int3 p = (base + node) * 2 + o;
                if (!exists(p)) {
                    continue;
                }
                const double value = own.at(node, slot);
                const auto against = [&](double child, const Int3& at, std::int64_t scale) {
                    ++compared;
                    if (!(value >= child)) {
                        add("saturation", array, chunk, p * (std::int64_t{1} << (array.level - 1)),
                            fmt::format("{} is less than {} at its child {} {} {}", value, child,
                                        at.x * scale, at.y * scale, at.z * scale));
                    }
                };
                const std::int64_t odd = o.x + o.y + o.z;
                if (odd >= 2) {
                    for (int axis = 0; axis < 3; ++axis) {
                        for (std::int64_t side = -1; side <= 1 && o[axis] != 0; side += 2) {
                            Int3 c = p;
                            c[axis] += side;
                            const Int3 q = c - base * 2;
                            against(own.at({q.x >> 1, q.y >> 1, q.z >> 1}, slot_of(q)), c,
                                    std::int64_t{1} << (array.level - 1));
                        }
                    }
                } else if (fine != nullptr) {
                    finer_centres(*fine, p, base, finer, against);
                }
            }
        }
        count_nodes(compared);
    }

    /// The centres of the up to eight cubes of level L-1 around the edge midpoint p.
    template <class F>
    void finer_centres(const ArrayInfo& fine, const Int3& p, const Int3& base,
                       std::array<IndicatorView, 27>& finer, F&& against) {
        const Int3 cells = layout_.lattice().elements_at(fine.level);
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 cube = p - Int3{i & 1, (i >> 1) & 1, i >> 2};
            // Along a flat axis p is 0, and so is the square.
            if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} ||
                max(cube + Int3{1, 1, 1}, cells) != cells) {
                continue;
            }
            // Cubes 2 base - 1 to 2 (base + chunk): in one of the blocks of chunks around.
            const Int3 local = cube - base * 2;
            Int3 block;
            Int3 rest;
            for (int axis = 0; axis < 3; ++axis) {
                const std::int64_t size = 2 * fine.chunk[axis];
                block[axis] = local[axis] < 0 ? 0 : local[axis] < size ? 1 : 2;
                rest[axis] = local[axis] - (block[axis] - 1) * size;
            }
            const int centre = layout_.lattice().centre_slot();
            against(finer[static_cast<std::size_t>((Int3{3, 3, 3}).linear(block))].at(rest, centre),
                    cube * 2 + slot_offset(centre), std::int64_t{1} << (fine.level - 1));
        }
    }

    /// Level 1: the stored centre of each cube against the indicators of its 19 nodes, which follow
    /// from the values: never below, and at most the codes' rounding above.
    void finest_bounds(const ArrayInfo& array, const Int3& chunk) {
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, layout_.lattice().elements_at(1) - base);
        if (min(n, {1, 1, 1}) != Int3{1, 1, 1}) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            Box<T> values(base * 2, n * 2 + Int3{1, 1, 1});
            gather_values(cache_, layout_.array(0, Field::values), values);
            IndicatorView own(cache_, array, base);
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const Int3 cube = base + n.unlinear(i);
                const double stored = own.at(cube - base, array.first_slot);
                const double computed =
                    finest_indicator(cube_values(values, cube), position_of_slot(array.first_slot),
                                     saturation_of(array.field) == Saturation::plus);
                if (!(stored >= computed) || !(stored <= computed * (1 + 0x1p-7) + kSmallestCode)) {
                    add("indicator", array, chunk, cube * 2 + slot_offset(array.first_slot),
                        fmt::format("{} is stored, {} follows from the values", stored, computed));
                }
            }
            count_nodes(n.product());
        });
    }

    void source_values() {
        const ArrayInfo& array = layout_.array(0, Field::values);
        const Int3 n = array.nodes;
        progress_.begin("compare with source", static_cast<std::uint64_t>(n.z), "planes");
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const std::int64_t rows =
                std::clamp<std::int64_t>(static_cast<std::int64_t>(options_.memory / 8) /
                                             (n.x * static_cast<std::int64_t>(sizeof(T))),
                                         1, n.y);
            std::vector<T> original(static_cast<std::size_t>(n.x * rows));
            for (std::int64_t z = 0; z < n.z; ++z) {
                progress_.check();
                for (std::int64_t y = 0; y < n.y; y += rows) {
                    const std::int64_t ny = std::min(rows, n.y - y);
                    options_.source(z, y, ny, reinterpret_cast<std::byte*>(original.data()));
                    Box<T> ours({0, y, z}, {n.x, ny, 1});
                    try {
                        gather_values(cache_, array, ours);
                    } catch (const Error& error) {
                        if (error.kind() != ErrorKind::corrupt) {
                            throw;
                        }
                        continue;
                    }
                    for (std::size_t i = 0; i < ours.data.size(); ++i) {
                        if (std::memcmp(&ours.data[i], &original[i], sizeof(T)) != 0) {
                            const Int3 p =
                                Int3{0, y, z} + ours.size.unlinear(static_cast<std::int64_t>(i));
                            add("source", array, array.chunk_of(p), p,
                                "the value differs from the source's");
                        }
                    }
                    count_nodes(n.x * ny);
                }
                progress_.advance(1);
            }
        });
    }

    /// The largest difference between U and the linear function of each tetrahedron, node by node,
    /// in cubes drawn over all levels, against the bounds stored for them.
    template <class T>
    void sampled_bounds() {
        const Lattice& lattice = layout_.lattice();
        if (lattice.top() == 0) {
            return;
        }
        std::uint64_t state = 0x9E3779B97F4A7C15ULL;
        const auto random = [&](std::int64_t n) {
            state ^= state << 13U;
            state ^= state >> 7U;
            state ^= state << 17U;
            return static_cast<std::int64_t>(state % static_cast<std::uint64_t>(n));
        };
        progress_.begin("bounds", options_.sampled_cubes, "cubes");
        for (std::uint64_t s = 0; s < options_.sampled_cubes; ++s) {
            progress_.check();
            const int level = 1 + static_cast<int>(random(std::min(lattice.top(), 5)));
            const Int3 cells = lattice.elements_at(level);
            const Int3 cube{random(cells.x), random(cells.y), random(cells.z)};
            try {
                brute_force<T>(level, cube);
            } catch (const Error& error) {
                if (error.kind() != ErrorKind::corrupt) {
                    throw;
                }
            }
            ++report_.cubes;
            progress_.advance(1);
        }
    }

    template <class T>
    void brute_force(int level, const Int3& cube) {
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 low = cube * edge;
        Box<T> box(low, {edge + 1, edge + 1, edge + 1});
        gather_values(cache_, layout_.array(0, Field::values), box);
        const LargestDifference found =
            largest_difference(box, cube, edge, layout_.lattice().nodes() - Int3{1, 1, 1});
        for (const Field field : {Field::deviation_bar, Field::deviation_plus, Field::linf_plus}) {
            if (!layout_.has(field)) {
                continue;
            }
            const ArrayInfo& array = layout_.array(level, field);
            const Int3 chunk = array.chunk_of(cube);
            const Int3 base = array.first_node(chunk);
            IndicatorView view(cache_, array, base);
            const int centre = layout_.lattice().centre_slot();
            const double bound = view.at(cube - base, centre);
            if (!(bound >= found.difference - 1e-12 * found.size)) {
                add("bound", array, chunk, low + Int3{edge / 2, edge / 2, edge / 2},
                    fmt::format("{} is less than the difference {} that there is", bound,
                                found.difference));
            }
        }
    }

    const StoreReader& store_;
    const StoreLayout& layout_;
    const CheckOptions& options_;
    Progress& progress_;
    ChunkCache cache_;
    std::mutex mutex_;
    std::set<std::uint64_t> damaged_;
    CheckReport report_;
};

}  // namespace

CheckReport check(const StoreReader& store, const CheckOptions& options, Progress& progress) {
    return Workers(options.threads).execute([&] {
        return Checker(store, options, progress).run();
    });
}

}  // namespace isonest
