// Which stored bytes a surface needs and which the extraction reads, for each chunk array.
//
// usage: isonest_chunk_bytes STORE ISOVALUE ERROR_RELATIVE [MEMORY_MIB]
//
// A surface needs the chunks with the corners of leaf tetrahedra (values of their level) or their
// refinement nodes (the stored deviation_bar; at level 1 all but the centres follow from values of
// level 0). The leaves come from the traversal itself; the reads come from the chunk source, one
// each time that a chunk is decoded.
#include <fmt/format.h>

#include <bit>
#include <cstdlib>
#include <mutex>
#include <set>

#include <isonest/error.h>

#include "query/traverse/traversal.h"
#include "store/container/reader.h"
#include "store/container/wrapped_sources.h"
#include "tools/bench/run_program.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

/// Rows of the chunk table.
using Chunks = std::set<std::uint64_t>;

std::int64_t squared_length(const Int3& d) {
    return d.x * d.x + d.y * d.y + d.z * d.z;
}

/// Twice the midpoint of the longest edge.
Int3 refinement_node_twice(const Leaf& leaf) {
    Int3 found;
    std::int64_t longest = 0;
    for (std::size_t i = 0; i < 4; ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            const Int3& a = leaf.corners[i].node;
            const Int3& b = leaf.corners[j].node;
            if (squared_length(a - b) > longest) {
                longest = squared_length(a - b);
                found = a + b;
            }
        }
    }
    return found;
}

void need(const StoreLayout& layout, const Leaf& leaf, Chunks& needed) {
    const auto add = [&](int level, Field field, const Int3& node) {
        const ArrayInfo& array = layout.array(level, field);
        needed.insert(array.row_of(array.chunk_of(node)));
    };
    const auto at_level = [](const Int3& p, int level) {
        const auto shift = static_cast<unsigned>(level);
        return Int3{p.x >> shift, p.y >> shift, p.z >> shift};
    };
    for (const Corner& corner : leaf.corners) {
        add(leaf.level, Field::values, at_level(corner.node, leaf.level));
    }
    const Int3 twice = refinement_node_twice(leaf);
    if (((twice.x | twice.y | twice.z) & 1) != 0) {
        return;  // at level 0, where nothing refines it
    }
    const Int3 node = at_level(twice, 1);
    const int level = std::countr_zero(static_cast<std::uint64_t>(node.x | node.y | node.z)) + 1;
    const Int3 owner = at_level(node, level);
    const Int3 offset = at_level(node, level - 1) - owner * 2;
    const bool centre = offset.x == 1 && offset.y == 1 && offset.z == 1;
    if (level == 1 && !centre) {
        add(0, Field::values, node);
    } else {
        add(level, Field::deviation_bar, owner);
    }
}

int run(int argc, char** argv) {
    if (argc < 4) {
        fmt::print(stderr,
                   "usage: isonest_chunk_bytes STORE ISOVALUE ERROR_RELATIVE [MEMORY_MIB]\n");
        return 2;
    }
    const StoreReader store(argv[1]);
    const StoreLayout& layout = store.layout();
    const RecordingSource recorder(store);
    ChunkCache cache(recorder, (argc > 4 ? std::strtoull(argv[4], nullptr, 10) : 256U) << 20U);
    TraversalQuery query;
    query.iso = std::strtod(argv[2], nullptr);
    query.tolerance =
        Tolerance(std::strtod(argv[3], nullptr) * (store.max_value() - store.min_value()), {}, {},
                  layout.header().spacing, layout.header().origin);
    for (int axis = 0; axis < 3; ++axis) {
        query.box.hi[static_cast<std::size_t>(axis)] =
            static_cast<double>(layout.lattice().nodes()[axis] - 1);
    }
    std::mutex mutex;
    Chunks needed;
    query.on_leaf = [&](const Leaf& leaf) {
        bool below = false;
        bool not_below = false;
        for (const Corner& corner : leaf.corners) {
            below = below || corner.value < query.iso;
            not_below = not_below || corner.value >= query.iso;
        }
        if (below && not_below) {
            const std::lock_guard lock(mutex);
            need(layout, leaf, needed);
        }
    };
    Progress quiet;
    const TraversalCounts counts = traverse(
        cache, query, 65536, [](std::uint64_t, const MeshPart&) {}, quiet);

    struct Sum {
        std::uint64_t chunks = 0;
        std::uint64_t bytes = 0;
        void add(std::uint64_t more) {
            ++chunks;
            bytes += more;
        }
    };
    Sum all_needed;
    Sum all_read;
    fmt::print("{:>28} {:>8} {:>10} {:>8} {:>10}\n", "array", "needed", "bytes", "read", "bytes");
    for (const ArrayInfo& array : layout.arrays()) {
        if (array.alias) {
            continue;
        }
        Sum array_needed;
        Sum array_read;
        for (std::int64_t i = 0; i < array.grid.product(); ++i) {
            const Int3 chunk = array.grid.unlinear(i);
            const std::uint64_t bytes = store.row(array, chunk).bytes;
            if (needed.contains(array.row_of(chunk))) {
                array_needed.add(bytes);
                all_needed.add(bytes);
            }
            if (recorder.decoded().contains(array.row_of(chunk))) {
                array_read.add(bytes);
                all_read.add(bytes);
            }
        }
        if (array_read.chunks != 0 || array_needed.chunks != 0) {
            fmt::print("{:>28} {:>8} {:>10} {:>8} {:>10}\n",
                       fmt::format("{}/{}", array.level, name_of(array.field)), array_needed.chunks,
                       array_needed.bytes, array_read.chunks, array_read.bytes);
        }
    }
    fmt::print("read {} bytes ({} with what was decoded again), needed {}: {:.2f} x\n",
               all_read.bytes, cache.bytes_read(), all_needed.bytes,
               static_cast<double>(cache.bytes_read()) / static_cast<double>(all_needed.bytes));
    fmt::print("visited {} tetrahedra, {} leaves: {:.2f} x\n", counts.visited, counts.leaves,
               static_cast<double>(counts.visited) / static_cast<double>(counts.leaves));
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run_program("isonest_chunk_bytes", [&] { return run(argc, argv); });
}
