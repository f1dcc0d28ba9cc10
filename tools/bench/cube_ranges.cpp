// What the smallest and largest values of cubes and chunks save, compared with the bounds alone.
// The paper claims that bounds from the indicators make a min/max tree unnecessary.
//
// usage: isonest_cube_ranges STORE ISOVALUE [ROUNDS]
//
// The same surface is traversed with and without the ranges, with the bound deviation_bar and with
// linf_plus (the paper's beta_0 without its factor 1/2): within 1 % of the range, within almost 0
// (so that all levels are traversed), and at full resolution. Without the ranges, a surface at full
// resolution reads all values, because there the chunk table replaces the bounds.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <optional>
#include <vector>

#include <isonest/error.h>

#include "query/traverse/traversal.h"
#include "store/container/reader.h"
#include "store/container/wrapped_sources.h"
#include "tools/bench/run_program.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

/// A store without ranges of values in cubes and chunks.
class WithoutRanges : public ForwardingSource {
  public:
    using ForwardingSource::ForwardingSource;
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override {
        ChunkRow row = source().row(array, chunk);
        row.min = -std::numeric_limits<double>::infinity();
        row.max = std::numeric_limits<double>::infinity();
        return row;
    }
    [[nodiscard]] std::optional<CubeRange> cube_range(int /*level*/,
                                                      const Int3& /*cube*/) const override {
        return std::nullopt;
    }
};

struct Measured {
    TraversalCounts counts;
    std::uint64_t bytes = 0;
    std::uint64_t chunks = 0;
    double seconds = std::numeric_limits<double>::infinity();  ///< minimum of the rounds
};

void measure(const ChunkSource& source, const TraversalQuery& query, Measured& measured) {
    constexpr std::uint64_t kCache = std::uint64_t{512} << 20U;
    constexpr std::size_t kPartVertices = 65536;
    ChunkCache cache(source, kCache);
    Progress quiet;
    const auto begin = std::chrono::steady_clock::now();
    measured.counts = traverse(
        cache, query, kPartVertices, [](std::uint64_t, const MeshPart&) {}, quiet);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    measured.seconds = std::min(measured.seconds, seconds.count());
    measured.bytes = cache.bytes_read();
    measured.chunks = cache.chunks_read();
}

int run(int argc, char** argv) {
    if (argc < 3) {
        fmt::print(stderr, "usage: isonest_cube_ranges STORE ISOVALUE [ROUNDS]\n");
        return 2;
    }
    const StoreReader store(argv[1]);
    const WithoutRanges bare(store);
    const StoreLayout& layout = store.layout();
    const int rounds = argc > 3 ? std::atoi(argv[3]) : 5;
    const double range = store.max_value() - store.min_value();
    constexpr double kNextToNothing = 1e-9;
    constexpr double kCoarse = 0.01;
    fmt::print("{:>10} {:>14} {:>7} {:>12} {:>12} {:>8} {:>12} {:>8}\n", "tolerance", "bound",
               "ranges", "visited", "leaves", "chunks", "bytes", "seconds");
    for (const double tolerance : {kCoarse, kNextToNothing, 0.0}) {
        for (const Field bound : {Field::deviation_bar, Field::linf_plus}) {
            TraversalQuery query;
            query.iso = std::strtod(argv[2], nullptr);
            query.bound = bound;
            query.tolerance = Tolerance(tolerance * range, {}, {}, layout.header().spacing,
                                        layout.header().origin);
            for (int axis = 0; axis < 3; ++axis) {
                query.box.hi[static_cast<std::size_t>(axis)] =
                    static_cast<double>(layout.lattice().nodes()[axis] - 1);
            }
            Measured with;
            Measured without;
            for (int round = 0; round < rounds; ++round) {
                measure(store, query, with);
                measure(bare, query, without);
            }
            for (const bool ranges : {true, false}) {
                const Measured& m = ranges ? with : without;
                fmt::print("{:>10g} {:>14} {:>7} {:>12} {:>12} {:>8} {:>12} {:>8.3f}\n", tolerance,
                           name_of(bound), ranges ? "yes" : "no", m.counts.visited, m.counts.leaves,
                           m.chunks, m.bytes, m.seconds);
            }
            if (tolerance == 0) {
                break;  // the bounds are not used
            }
        }
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run_program("isonest_cube_ranges", [&] { return run(argc, argv); });
}
