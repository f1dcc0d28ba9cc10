#include "query/check/check_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "query/check/check_levels.h"
#include "query/values/brick_view.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {
namespace {

class SourceChecks {
  public:
    SourceChecks(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                 Progress& progress)
        : cache_(cache),
          layout_(cache.source().layout()),
          options_(options),
          source_(*options.source),
          findings_(findings),
          progress_(progress) {}

    void source_values() {
        const ArrayInfo& array = layout_.array(0, Field::values);
        const Int3 n = array.nodes;
        progress_.begin("compare with source", static_cast<std::uint64_t>(n.z), "planes");
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const auto [planes, rows] = piece(n, array.chunk, sizeof(T));
            std::vector<T> original(static_cast<std::size_t>(n.x * rows * planes));
            for (std::int64_t z = 0; z < n.z; z += planes) {
                const std::int64_t nz = std::min(planes, n.z - z);
                for (std::int64_t y = 0; y < n.y; y += rows) {
                    progress_.check();
                    const std::int64_t ny = std::min(rows, n.y - y);
                    source_.read(z, nz, y, ny, reinterpret_cast<std::byte*>(original.data()));
                    compare<T>({{0, y, z}, {n.x, ny, nz}}, original);
                }
                progress_.advance(static_cast<std::uint64_t>(nz));
            }
        });
    }

    /// Compares the largest difference between U and the linear function of each tetrahedron, node
    /// by node, in cubes sampled from all levels, with the bounds stored for them.
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
            findings_.count(0, 0, 1);
            progress_.advance(1);
        }
    }

    /// The positions of a curvilinear grid's nodes, if the source has them.
    void source_positions() {
        const NodePositionsPtr given = source_.describe().curved;
        if (!given || !layout_.header().curved) {
            return;
        }
        for (const ArrayInfo& array : layout_.positions()) {
            VolumeSource& source =
                *given->coordinates.at(static_cast<std::size_t>(array.coordinate));
            dispatch(layout_.header().curved->type, [&](auto stored) {
                dispatch(source.describe().type, [&](auto original) {
                    compare_coordinates<typename decltype(stored)::type,
                                        typename decltype(original)::type>(array, source);
                });
            });
        }
    }

  private:
    /// Plane by plane, in pieces of the rows of a chunk.
    template <class T, class Original>
    void compare_coordinates(const ArrayInfo& array, VolumeSource& source) {
        const Int3 n = array.nodes;
        const std::int64_t rows = source.sequential() ? n.y : std::min(array.chunk.y, n.y);
        progress_.begin("positions", static_cast<std::uint64_t>(n.z), "planes");
        std::vector<Original> given(static_cast<std::size_t>(n.x * rows));
        for (std::int64_t z = 0; z < n.z; ++z) {
            progress_.check();
            for (std::int64_t y = 0; y < n.y; y += rows) {
                const Int3 size{n.x, std::min(rows, n.y - y), 1};
                source.read(z, 1, y, size.y, reinterpret_cast<std::byte*>(given.data()));
                Box<T> ours({0, y, z}, size);
                try {
                    gather_values(cache_, array, ours);
                } catch (const Error& error) {
                    if (error.kind() != ErrorKind::corrupt) {
                        throw;
                    }
                    continue;  // reported as damaged
                }
                for (std::size_t i = 0; i < ours.data.size(); ++i) {
                    if (ours.data[i] != static_cast<T>(given[i])) {
                        const Int3 p = Int3{0, y, z} + size.unlinear(static_cast<std::int64_t>(i));
                        findings_.add("source", array, array.chunk_of(p), p,
                                      "the position differs from the source's");
                    }
                }
            }
            progress_.advance(1);
        }
    }

    struct Part {
        Int3 low;
        Int3 size;
    };

    /// The number of planes and rows read at a time: the source's granularity, then as many as
    /// needed to decode each chunk of the store only once, then whole planes, up to an eighth of
    /// the memory. If that is less than a layer of the source's chunks, these are decoded again for
    /// each piece.
    [[nodiscard]] std::pair<std::int64_t, std::int64_t> piece(const Int3& n, const Int3& chunk,
                                                              std::size_t value) const {
        const VolumeSource::Granularity order = source_.granularity();
        const std::int64_t most =
            std::max<std::int64_t>(1, static_cast<std::int64_t>(options_.memory / 8) /
                                          (n.x * static_cast<std::int64_t>(value)));
        const auto multiple = [](std::int64_t number, std::int64_t step, std::int64_t end) {
            return std::min(end, std::max<std::int64_t>(1, number / step) * step);
        };
        if (source_.sequential()) {
            return most >= n.y ? std::pair(std::min({most / n.y, chunk.z, n.z}), n.y)
                               : std::pair(std::int64_t{1}, multiple(most, order.rows, n.y));
        }
        std::int64_t planes = std::min(multiple(chunk.z, order.planes, n.z), most);
        const std::int64_t least = std::min(order.rows, n.y);
        if (planes * least > most) {
            planes = std::min(multiple(most / least, order.planes, n.z), most);
        }
        const std::int64_t rows = most / planes;
        return {planes, rows < least ? rows : multiple(rows, order.rows, n.y)};
    }

    void prefetch(const ArrayInfo& array, const Part& part) {
        if (!cache_.source().is_remote()) {
            return;
        }
        std::vector<WantedChunk> chunks;
        want_box(array, part.low, part.low + part.size - Int3{1, 1, 1}, chunks);
        ChunkNeeds needs;
        for (const WantedChunk& chunk : chunks) {
            needs.add(*chunk.array, chunk.chunk);
        }
        cache_.prefetch(needs.chunks());
    }

    /// Whether a value is the source's, or was rounded within the store's tolerance.
    template <class T>
    [[nodiscard]] bool agrees(T ours, T original) const {
        // Bitwise comparison, because NaN must equal itself.
        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
        if (std::memcmp(&ours, &original, sizeof(T)) == 0) {
            return true;
        }
        const DataRounding& rounding = layout_.header().rounding;
        return !rounding.none() && std::fabs(static_cast<double>(ours) -
                                             static_cast<double>(original)) <= rounding.tolerance;
    }

    template <class T>
    void compare(const Part& part, const std::vector<T>& original) {
        const ArrayInfo& array = layout_.array(0, Field::values);
        Box<T> ours(part.low, part.size);
        prefetch(array, part);
        try {
            gather_values(cache_, array, ours);
        } catch (const Error& error) {
            if (error.kind() != ErrorKind::corrupt) {
                throw;
            }
            compare_chunks(part, original);
            return;
        }
        for (std::size_t i = 0; i < ours.data.size(); ++i) {
            if (!agrees(ours.data[i], original[i])) {
                const Int3 p = part.low + part.size.unlinear(static_cast<std::int64_t>(i));
                findings_.add("source", array, array.chunk_of(p), p,
                              layout_.header().rounding.none()
                                  ? "the value differs from the source's"
                                  : "the value differs from the source's by more than the store's "
                                    "tolerance");
            }
        }
        findings_.count(part.size.product());
    }

    /// Compares, chunk by chunk, the data outside the store's damaged chunks.
    template <class T>
    void compare_chunks(const Part& part, const std::vector<T>& original) {
        const ArrayInfo& array = layout_.array(0, Field::values);
        const Int3 end = part.low + part.size;
        const Int3 first = array.chunk_of(part.low);
        const Int3 count = array.chunk_of(end - Int3{1, 1, 1}) - first + Int3{1, 1, 1};
        if (count.product() == 1) {
            return;
        }
        for (std::int64_t i = 0; i < count.product(); ++i) {
            const Int3 base = array.first_node(first + count.unlinear(i));
            const Int3 lo = max(base, part.low);
            const Int3 hi = min(base + array.chunk, end);
            std::vector<T> piece;
            for (std::int64_t z = lo.z; z < hi.z; ++z) {
                for (std::int64_t y = lo.y; y < hi.y; ++y) {
                    const auto from =
                        original.begin() + part.size.linear(Int3{lo.x, y, z} - part.low);
                    piece.insert(piece.end(), from, from + (hi.x - lo.x));
                }
            }
            compare<T>({lo, hi - lo}, piece);
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
            if (!(bound >= found.difference) && !(bound >= found.difference - 1e-12 * found.size)) {
                findings_.add("bound", array, chunk, low + Int3{edge / 2, edge / 2, edge / 2},
                              fmt::format("the bound {} is less than the actual difference {}",
                                          bound, found.difference));
            }
        }
    }

    ChunkCache& cache_;
    const StoreLayout& layout_;
    const CheckOptions& options_;
    VolumeSource& source_;
    Findings& findings_;
    Progress& progress_;
};

}  // namespace

void require_same_shape(const StoreReader& store, const VolumeSource& source) {
    const VolumeDescription volume = source.describe();
    const StoreHeader& h = store.layout().header();
    const Int3& n = volume.nodes;
    if (n != h.nodes || volume.type != h.type) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    fmt::format("is {} x {} x {} {}, but {} was made from {} x {} x {} {}", n.x,
                                n.y, n.z, name_of(volume.type), store.path().string(), h.nodes.x,
                                h.nodes.y, h.nodes.z, name_of(h.type)),
                    {{RemedyKind::choose_dataset}});
    }
}

void check_source(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                  Progress& progress) {
    SourceChecks checks(cache, options, findings, progress);
    checks.source_values();
    checks.source_positions();
    dispatch(cache.source().layout().header().type,
             [&](auto tag) { checks.sampled_bounds<typename decltype(tag)::type>(); });
}

}  // namespace isonest::detail
