// How many round trips, chunks and bytes queries take of a store behind a network, according to the
// model of store/container/wrapped_sources.h.
//
// usage: isonest_round_trips STORE ISOVALUE [MEMORY_MIB]
//
// Chunks are counted as read when the traversal decodes them, and as fetched when it prefetches
// them or requests them without a prefetch; fetched chunks that are not read were prefetched in
// vain. A surface within a distance begins with the full resolution, and reads no more than that.
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "query/traverse/traversal.h"
#include "store/container/reader.h"
#include "store/container/wrapped_sources.h"
#include "tools/bench/run_program.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

class Queries {
  public:
    Queries(const StoreReader& store, double iso, std::uint64_t memory)
        : store_(store), iso_(iso), memory_(memory) {
        fmt::print(
            "| {} levels | round trips | waves | not prefetched | chunks read | bytes read | "
            "chunks fetched | bytes fetched | fetched / read |\n"
            "|---|---|---|---|---|---|---|---|---|\n",
            store.layout().lattice().top() + 1);
    }

    /// `error`: relative to the range of the values.
    [[nodiscard]] TraversalQuery surface(double error) const {
        const StoreHeader& header = store_.layout().header();
        TraversalQuery query;
        query.iso = iso_;
        query.waiting_lists = memory_ / 8;
        query.tolerance = Tolerance(error * (store_.max_value() - store_.min_value()), {}, {},
                                    header.spacing, header.origin);
        for (int axis = 0; axis < 3; ++axis) {
            query.box.hi[static_cast<std::size_t>(axis)] =
                static_cast<double>(header.nodes[axis] - 1);
        }
        return query;
    }
    void print(const char* name, const TraversalQuery& query) const {
        const RemoteSource source(store_);
        ChunkCache cache(source, memory_ / 8 * 7,
                         query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
        Progress quiet;
        traverse(
            cache, query, 65536, [](std::uint64_t, const MeshPart&) {}, quiet);
        const RemoteCounts c = source.counts();
        fmt::print("| {} | {} | {} | {} | {} | {} | {} | {} | {:.2f} |\n", name, c.round_trips,
                   c.prefetches, c.not_prefetched, c.decoded_chunks, c.decoded_bytes,
                   c.fetched_chunks, c.fetched_bytes,
                   static_cast<double>(c.fetched_bytes) /
                       static_cast<double>(std::max<std::uint64_t>(c.decoded_bytes, 1)));
    }

  private:
    const StoreReader& store_;
    double iso_;
    std::uint64_t memory_;
};

int run(int argc, char** argv) {
    if (argc < 3) {
        fmt::print(stderr, "usage: isonest_round_trips STORE ISOVALUE [MEMORY_MIB]\n");
        return 2;
    }
    const StoreReader store(argv[1]);
    const Int3& nodes = store.layout().header().nodes;
    const Queries queries(store, std::strtod(argv[2], nullptr),
                          (argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 512U) << 20U);
    queries.print("surface, 5 %", queries.surface(0.05));
    queries.print("surface, 1 %", queries.surface(0.01));
    queries.print("surface, 0.2 %", queries.surface(0.002));
    TraversalQuery query = queries.surface(0.01);
    query.attributes.normal = true;
    queries.print("1 %, normals", query);
    for (const double error : {0.01, 0.0}) {
        query = queries.surface(error);
        query.plane = LatticePlane{{0, 0, 1}, static_cast<double>(nodes.z / 2) + 0.5};
        queries.print(error > 0 ? "slice, 1 %" : "slice, full", query);
    }
    queries.print("full resolution", queries.surface(0));
    query = queries.surface(0);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        query.box.lo[axis] = query.box.hi[axis] * 0.25;
        query.box.hi[axis] *= 0.5;
    }
    queries.print("full resolution, box", query);
    query = queries.surface(0.01);
    query.vertices = VertexPlace::exact;
    queries.print("1 %, exact vertices", query);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run_program("isonest_round_trips", [&] { return run(argc, argv); });
}
