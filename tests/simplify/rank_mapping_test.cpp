// Blocks mapped by ranks: their messages, bit by bit, and meshes compared with those of one
// process.
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>

#include <isonest/error.h>

#include "query/extract/extract_query.h"
#include "query/ranks/packed_patch.h"
#include "query/simplify/collapse/map_mesh.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "tests/support/mapping_ranks.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;
using isonest::test::map_on_ranks;
using isonest::test::ThreadRanks;

namespace {

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

bool same_nodes(const std::optional<KeptNodes>& a, const std::optional<KeptNodes>& b) {
    return a.has_value() == b.has_value() &&
           (!a || (a->margin == b->margin && a->lattice.origin == b->lattice.origin &&
                   a->lattice.steps == b->lattice.steps && a->lattice.nodes == b->lattice.nodes));
}

struct PatchKind {
    std::uint32_t vertices = 0;
    std::uint32_t triangles = 0;
    bool is_full = false;
    bool has_copies = false;
    bool keeps_nodes = false;
};

/// Arbitrary bits, except for the numbers of vertices.
MappedPatch random_patch(std::mt19937& random, const PatchKind& kind) {
    MappedPatch patch;
    const auto any_float = [&] {
        const std::uint32_t bits = random();
        float value = 0;
        std::memcpy(&value, &bits, sizeof(value));
        return value;
    };
    const auto any_vertex = [&] { return static_cast<std::uint32_t>(random() % kind.vertices); };
    const auto any_bits = [&](std::size_t count) {
        std::vector<bool> bits(count);
        std::generate(bits.begin(), bits.end(), [&] { return random() % 2 == 0; });
        return bits;
    };
    patch.positions.resize(kind.vertices);
    for (auto& p : patch.positions) {
        p = {any_float(), any_float(), any_float()};
    }
    if (random() % 2 == 0) {
        patch.box.lo = {any_float(), any_float(), any_float()};
    }
    patch.shared = any_bits(kind.vertices);
    if (kind.has_copies) {
        patch.next_copy.resize(kind.vertices);
        std::generate(patch.next_copy.begin(), patch.next_copy.end(), any_vertex);
    }
    if (kind.keeps_nodes) {
        patch.kept_nodes =
            KeptNodes{{{0.1, -7, 1e300}, Double3{0.3, 1, 2.5}, {7, 1, 1LL << 40}}, 0.25};
    }
    for (std::uint32_t t = 0; t < kind.triangles; ++t) {
        patch.triangles.push_back({any_vertex(), any_vertex(), any_vertex()});
        Displacement d;
        if (!kind.is_full && random() % 4 != 0) {
            d = {{any_float(), -0.0F, any_float()}, {0, any_float(), 0}, any_float()};
        } else if (!kind.is_full) {
            d.lo[random() % 3] = -0.0F;
        }
        patch.displacements.push_back(d);
    }
    patch.tried = any_bits(kind.triangles);
    return patch;
}

/// A torus and a grid next to it, in some blocks.
Patch some_surface() {
    Patch patch = torus(300, 100, 80, 24, 0.5);
    append(patch, wavy_grid(120, 0.5), {-60, -60, 20});
    for (auto& p : patch.positions) {
        p = {p[0] + 110, p[1] + 110, p[2] + 30};
    }
    return patch;
}

struct MappedSurface {
    std::vector<ElementCorners> corners;
    double bound = 0;
    double limit = 0;
    bool operator==(const MappedSurface&) const = default;
};

struct Surface {
    const ScratchMesh& mesh;
    const ScratchFolder& folder;
    WorldLattice lattice;
    PatchBox box;
    double limit;  ///< 0: to a number of triangles
    bool consumes = false;

    MappedSurface mapped_by(BlockMapping& mapping, int threads) const {
        MappedSurface result;
        Workers(threads).execute([&] {
            MeshMapper mapper(mesh, lattice, box, folder, silent_progress());
            mapper.map_by(mapping);
            const MeshMapper::Consumed none = [](std::uint64_t, std::uint64_t) {};
            Mapped whole = mapper.full(mesh.corners(), consumes ? none : nullptr);
            const Mapped m = limit > 0 ? mapper.within(std::move(whole), limit)
                                       : mapper.down_to(whole, 6000, 0.1, 1e9);
            const CornerFile corners = mapper.corners(m);
            result = {{corners.all().begin(), corners.all().end()}, m.bound, m.limit};
        });
        return result;
    }
};

ExtractOptions options_of(int threads, std::uint64_t memory = std::uint64_t{1} << 30U) {
    ExtractOptions options;
    options.threads = threads;
    options.memory = memory;
    return options;
}

/// Triangles mapped by ranks other than 0.
std::uint64_t triangles_of(const std::vector<RankWork>& done) {
    return std::accumulate(
        done.begin() + 1, done.end(), std::uint64_t{0},
        [](std::uint64_t sum, const RankWork& w) { return sum + w.mapped_triangles; });
}

}  // namespace

TEST_CASE("Patches and their results are unchanged after packing and unpacking") {
    std::mt19937 random(34);
    std::vector<PatchKind> kinds{{0, 0},       {1, 0},        {1, 1},
                                 {65536, 999}, {65537, 1000}, {100000, 40000, false, true, true}};
    for (std::uint32_t i = 0; i < 60; ++i) {
        const auto vertices = static_cast<std::uint32_t>(1 + random() % 3000);
        kinds.push_back({vertices, static_cast<std::uint32_t>((vertices + 2) / 3 + random() % 3000),
                         i % 3 == 0, i % 2 == 0, i % 5 == 0});
    }
    for (const PatchKind& kind : kinds) {
        const MappedPatch patch = random_patch(random, kind);
        const std::vector<std::byte> packed = packed_patch(patch);
        const MappedPatch p = unpacked_patch(packed);
        REQUIRE(same_bits(p.positions, patch.positions));
        REQUIRE(same_bits(p.box, patch.box));
        REQUIRE(p.shared == patch.shared);
        REQUIRE(p.next_copy == patch.next_copy);
        REQUIRE(same_nodes(p.kept_nodes, patch.kept_nodes));
        REQUIRE(p.triangles == patch.triangles);
        REQUIRE(same_bits(p.displacements, patch.displacements));
        REQUIRE(p.tried == patch.tried);

        GoneTriangles gone(random() % 4096);
        for (std::size_t bin = 0; bin < gone.size(); bin += 1 + random() % 100) {
            gone[bin] = random() % 3;
        }
        const std::vector<std::byte> packed_left = packed_result(patch, gone);
        MappedBlock left;
        left.vertex = {5, 4};
        unpack_result(packed_left, left);
        REQUIRE(left.gone_at == gone);
        REQUIRE(left.vertex == std::vector<std::uint64_t>{5, 4});
        REQUIRE(left.patch.triangles == patch.triangles);
        REQUIRE(same_bits(left.patch.displacements, patch.displacements));
        REQUIRE(left.patch.tried == patch.tried);

        // The bounds used to divide the memory.
        if (kind.vertices <= 3 * kind.triangles) {
            REQUIRE(packed.size() <= 256 + kind.triangles * kMaxPackedPatch);
        }
        REQUIRE(packed_left.size() <= 64 + 8 * gone.size() + kind.triangles * kMaxPackedResult);
        if (kind.is_full) {
            REQUIRE(packed.size() <=
                    256 + kind.triangles * 7 + kind.vertices * (kind.has_copies ? 15 : 13));
        }

        std::vector<std::byte> cut = packed;
        cut.resize(cut.size() - 1);
        REQUIRE_THROWS_AS(unpacked_patch(cut), std::logic_error);
    }
}

TEST_CASE("Blocks of any length arrive complete, in messages of bounded size") {
    constexpr std::size_t kMax = Communicator::kMaxBytes;
    std::mt19937 random(2);
    std::vector<std::pair<int, std::vector<std::byte>>> blocks;
    for (const std::size_t size : {std::size_t{8}, kMax - 1, kMax, kMax + 1, 3 * kMax, 3 * kMax + 5,
                                   std::size_t{9}, std::size_t{1000}}) {
        std::vector<std::byte> block(size);
        std::generate(block.begin(), block.end(), [&] { return static_cast<std::byte>(random()); });
        const std::uint64_t length = size;
        std::memcpy(block.data(), &length, sizeof(length));
        blocks.emplace_back(1 + size % 2, block);
    }
    BlockSender sender;
    for (const auto& [to, block] : blocks) {
        sender.add(to, block);
    }
    std::array<std::uint64_t, 3> prefetched{sender.messages(0), sender.messages(1),
                                            sender.messages(2)};
    std::array<BlockReceiver, 3> receivers;
    std::size_t whole = 0;
    for (Communicator::Message message; sender.next(message); message = {}) {
        const auto to = static_cast<std::size_t>(message.to);
        REQUIRE(message.bytes.size() <= kMax);
        REQUIRE(prefetched[to]-- > 0);
        if (const auto block = receivers[to].take(message.bytes)) {
            REQUIRE(message.to == blocks[whole].first);
            REQUIRE(*block == blocks[whole].second);
            ++whole;
        }
    }
    REQUIRE(whole == blocks.size());
    REQUIRE(prefetched == std::array<std::uint64_t, 3>{});
}

TEST_CASE("A mesh mapped by ranks is the same as one mapped by a single process") {
    const TemporaryFolder folder;
    Patch patch = some_surface();
    PatchBox box;
    box.lo[2] = 50 - 0.5F;  // across the grid
    WorldLattice lattice;
    lattice.nodes = {221, 221, 61};
    const bool is_stretched = GENERATE(false, true);
    if (is_stretched) {
        for (auto& p : patch.positions) {
            p = {p[0] * 0.4F - 3, p[1] * 1.5F, p[2] * 2 + 5};
        }
        box.lo[2] = box.lo[2] * 2 + 5;
        box.hi[0] = 59 * 0.4F + 50 * 0.4F - 3;
        lattice.origin = {-3, 0, 5};
        lattice.steps = Double3{0.4, 1.5, 2};
    }
    ScratchMesh mesh(folder.path());
    fill(mesh, patch);
    const std::uint64_t least = kLibraryHeap + map_heap();
    for (const double limit : {0.3, 1.5, 0.0}) {
        Surface surface{mesh, folder.path(), lattice, box, limit, limit > 1};
        LocalMapping local;
        const MappedSurface alone = surface.mapped_by(local, 1);
        REQUIRE(alone.corners.size() < patch.triangles.size() / 2);
        constexpr std::uint64_t kMuch = std::uint64_t{1} << 30U;
        const std::uint64_t little = least + (9U << 20U);
        for (const auto& [size, threads, memory] : {std::tuple(1, 1, kMuch),
                                                    {2, 1, kMuch},
                                                    {3, 2, kMuch},
                                                    {7, 1, kMuch},
                                                    {3, 2, little},
                                                    {2, 1, least}}) {
            MappedSurface shared;
            const auto done = map_on_ranks(size, options_of(threads, memory),
                                           [&, count = threads](BlockMapping& mapping) {
                                               shared = surface.mapped_by(mapping, count);
                                           });
            REQUIRE(shared == alone);
            // All ranks work if their memory is enough for blocks.
            const std::uint64_t others = triangles_of(done);
            if (size == 1 || memory == least) {
                REQUIRE(others == 0);
            } else if (memory == little) {
                REQUIRE(others > 0);
            } else {
                REQUIRE(others > patch.triangles.size() / 2);
                REQUIRE(std::all_of(done.begin(), done.end(),
                                    [](const RankWork& w) { return w.mapped_blocks > 0; }));
            }
        }
    }
}

TEST_CASE("Ranks serve one mesh after another, and none at all") {
    const TemporaryFolder folder;
    const Patch patch = some_surface();
    ScratchMesh mesh(folder.path());
    fill(mesh, patch);
    ScratchMesh nothing(folder.path());
    fill(nothing, {});
    WorldLattice lattice;
    lattice.nodes = {221, 221, 61};
    LocalMapping local;
    const Surface surface{mesh, folder.path(), lattice, {}, 0.5};
    const Surface empty{nothing, folder.path(), lattice, {}, 0.5};
    const MappedSurface alone = surface.mapped_by(local, 1);
    map_on_ranks(3, options_of(1), [&](BlockMapping& mapping) {
        mapping.finish();
        for (int i = 0; i < 2; ++i) {
            REQUIRE(surface.mapped_by(mapping, 1) == alone);
            REQUIRE(empty.mapped_by(mapping, 1).corners.empty());
            mapping.finish();
        }
        REQUIRE(surface.mapped_by(mapping, 2) == alone);
    });
    map_on_ranks(3, options_of(1), [](BlockMapping&) {});
}

TEST_CASE("A rank that fails while blocks are mapped ends all ranks") {
    /// Stops after a number of calls.
    class Stop : public Progress {
      public:
        explicit Stop(int after) : left_(after) {}
        [[nodiscard]] bool cancelled() const override { return --left_ < 0; }

      private:
        mutable std::atomic<int> left_;
    };
    const TemporaryFolder folder;
    const Patch patch = some_surface();
    ScratchMesh mesh(folder.path());
    fill(mesh, patch);
    WorldLattice lattice;
    lattice.nodes = {221, 221, 61};
    const ScratchFolder scratch = folder.path();
    for (const int failing : {0, 1, 2}) {
        for (const int after : {0, 3}) {
            std::atomic<int> ended = 0;
            const auto work = [&](Communicator& ranks) {
                RankTeam team{ranks};
                Stop stop(ranks.rank() == failing ? after : 1000000);
                try {
                    if (ranks.rank() == 0) {
                        RankMapping mapping(team, memory_of(options_of(1), "a mesh"));
                        Workers(1).execute([&] {
                            MeshMapper mapper(mesh, lattice, {}, scratch, stop);
                            mapper.map_by(mapping);
                            static_cast<void>(mapper.within(mapper.full(mesh.corners()), 0.5));
                        });
                        mapping.finish();
                    } else if (ranks.broadcast({}) == kBlocksToMap) {
                        serve_blocks(team, memory_of(options_of(1), "a mesh"), stop);
                    }
                } catch (const Error& e) {
                    ended += e.kind() == ErrorKind::cancelled ? 1 : 0;
                    throw;
                }
            };
            REQUIRE_THROWS_AS(ThreadRanks(3).run(work), Error);
            REQUIRE(ended == 3);
        }
    }
}

TEST_CASE("A rank whose memory holds no block reports how much would") {
    ThreadRanks ranks(2);
    const auto work = [&](Communicator& rank) {
        if (rank.rank() == 1) {
            RankTeam team{rank};
            serve_blocks(team, memory_of(options_of(1, kLibraryHeap), "a mesh"), silent_progress());
        } else {
            rank.gather({});
        }
    };
    try {
        ranks.run(work);
        FAIL("it served without memory");
    } catch (const Error& e) {
        REQUIRE(e.kind() == ErrorKind::limit);
        REQUIRE(!e.remedies().empty());
    }
}
