#include "query/check_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "query/brick_view.h"
#include "query/brute_force.h"
#include "store/error.h"
#include "store/gather.h"

namespace isonest {
namespace {

class SourceChecks {
  public:
    SourceChecks(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                 Progress& progress)
        : cache_(cache),
          layout_(cache.source().layout()),
          options_(options),
          findings_(findings),
          progress_(progress) {}

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
                        // Bit by bit: NaN is the same as itself.
                        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
                        if (std::memcmp(&ours.data[i], &original[i], sizeof(T)) != 0) {
                            const Int3 p =
                                Int3{0, y, z} + ours.size.unlinear(static_cast<std::int64_t>(i));
                            findings_.add("source", array, array.chunk_of(p), p,
                                          "the value differs from the source's");
                        }
                    }
                    findings_.count(n.x * ny);
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
            findings_.count(0, 0, 1);
            progress_.advance(1);
        }
    }

  private:
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
                              fmt::format("{} is less than the difference {} that there is", bound,
                                          found.difference));
            }
        }
    }

    ChunkCache& cache_;
    const StoreLayout& layout_;
    const CheckOptions& options_;
    Findings& findings_;
    Progress& progress_;
};

}  // namespace

void check_source(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                  Progress& progress) {
    SourceChecks checks(cache, options, findings, progress);
    checks.source_values();
    dispatch(cache.source().layout().header().type,
             [&](auto tag) { checks.sampled_bounds<typename decltype(tag)::type>(); });
}

}  // namespace isonest
