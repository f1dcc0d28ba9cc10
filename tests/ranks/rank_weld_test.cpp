// Vertex numbers of a mesh whose parts are on several ranks, compared with those of Weld.
#include "query/ranks/rank_weld.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdint>
#include <map>
#include <mutex>
#include <random>
#include <vector>

#include "query/march/mesh_part.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// A part and its position in the order of all parts.
struct OrderedPart {
    std::uint64_t order = 0;
    MeshPart part;
};
using Parts = std::vector<OrderedPart>;

VertexKey key_of(std::uint64_t vertex, std::uint64_t name) {
    return {vertex, name, VertexKind::fan, 0};
}

std::uint32_t add_vertex(MeshPart& part) {
    part.positions.push_back({1.0 * static_cast<double>(part.positions.size()), 0, 0});
    return static_cast<std::uint32_t>(part.positions.size() - 1);
}

/// Adds an element with these names of a vertex of the mesh. If `has_vertex`, it contains the
/// vertex, otherwise it only links the names.
std::uint32_t add_shared(MeshPart& part, std::uint64_t vertex,
                         const std::vector<std::uint64_t>& names, bool has_vertex = true) {
    const auto element = static_cast<std::uint32_t>(part.shared.size());
    part.shared.push_back({has_vertex ? add_vertex(part) : MeshPart::kNoVertex});
    for (const std::uint64_t name : names) {
        part.names.push_back({key_of(vertex, name), element});
    }
    return element;
}

/// Parts in which vertices of `vertices` occur at random, with some of their names each, links
/// between names, and cuts.
Parts random_parts(std::size_t count, std::uint64_t vertices, std::mt19937& random) {
    const auto below = [&](std::uint64_t n) {
        return std::uniform_int_distribution<std::uint64_t>(0, n - 1)(random);
    };
    Parts parts(count);
    for (std::size_t p = 0; p < count; ++p) {
        parts[p].order = 10 * p + below(10);
        MeshPart& part = parts[p].part;
        std::map<std::uint64_t, std::uint32_t> elements;
        for (std::uint64_t i = below(12); i > 0; --i) {
            const std::uint64_t v = below(vertices);
            if (elements.count(v) > 0) {
                continue;
            }
            for (std::uint64_t own = below(3); own > 0; --own) {
                add_vertex(part);
            }
            std::vector<std::uint64_t> names{below(3)};
            if (below(3) == 0) {
                names.push_back((names.front() + 1) % 3);
            }
            elements[v] = add_shared(part, v, names, below(6) > 0);
        }
        if (elements.size() > 1) {
            const std::uint32_t a = elements.begin()->second;
            const std::uint32_t b = elements.rbegin()->second;
            const std::uint32_t cut = add_shared(part, 0, {});
            part.cuts.push_back({a, b, static_cast<std::uint32_t>(below(2)), cut});
        }
    }
    return parts;
}

struct Numbered {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    std::uint64_t first_triangle = 0;
    bool operator==(const Numbered&) const = default;
};
/// The numbers of each part, by its order.
using Numbers = std::map<std::uint64_t, Numbered>;

void fill(PartStore& store, const Parts& parts, const std::vector<int>& rank_of, int rank) {
    for (std::size_t p = 0; p < parts.size(); ++p) {
        if (rank < 0 || rank_of[p] == rank) {
            store.append(parts[p].order, parts[p].part);
        }
    }
    store.seal();
}

Numbers numbers_of(const PartStore& store, const VertexNumbers& weld) {
    Numbers all;
    for (const PartRecord& r : store.records()) {
        Numbered n;
        n.vertices = weld.vertices();
        n.triangles = weld.triangles();
        n.first_triangle = r.first_triangle;
        weld.numbers(r, n.number, n.owned);
        CHECK(static_cast<std::uint32_t>(std::count(n.owned.begin(), n.owned.end(), true)) ==
              r.owned);
        all[r.order] = n;
    }
    return all;
}

Numbers by_one(const Parts& parts) {
    const TemporaryFolder folder;
    PartStore store(folder.path(), {}, {}, 1U << 20U);
    fill(store, parts, {}, -1);
    return numbers_of(store, Weld(store, folder.path()));
}

Numbers by_ranks(int size, const Parts& parts, const std::vector<int>& rank_of) {
    const TemporaryFolder folder;
    Numbers all;
    std::mutex mutex;
    isonest::test::ThreadRanks(size).run([&](Communicator& ranks) {
        PartStore store(folder.path(), {}, {}, 1U << 20U);
        fill(store, parts, rank_of, ranks.rank());
        const RankWeld weld(ranks, store, folder.path());
        const std::lock_guard lock(mutex);
        all.merge(numbers_of(store, weld));
    });
    return all;
}

}  // namespace

TEST_CASE("ranks number vertices as one process does") {
    std::mt19937 random(3);
    for (int round = 0; round < 60; ++round) {
        CAPTURE(round);
        const Parts parts = random_parts(1 + static_cast<std::size_t>(round),
                                         3 + static_cast<std::uint64_t>(round), random);
        const Numbers expected = by_one(parts);
        for (const int size : {1, 2, 3, 5}) {
            std::vector<int> rank_of(parts.size());
            for (int& rank : rank_of) {
                rank = std::uniform_int_distribution(0, size - 1)(random);
            }
            CAPTURE(size);
            CHECK(by_ranks(size, parts, rank_of) == expected);
        }
        // One rank has all parts, and the others none.
        CHECK(by_ranks(4, parts, std::vector<int>(parts.size(), 2)) == expected);
    }
}

TEST_CASE("a vertex whose parts are linked across many ranks gets one number") {
    // Part i has the names i and i + 1, so that the first and the last are linked through all
    // others.
    constexpr int kParts = 9;
    Parts parts;
    for (int i = 0; i < kParts; ++i) {
        OrderedPart& p = parts.emplace_back();
        p.order = static_cast<std::uint64_t>(i * 7 % kParts);
        const auto name = static_cast<std::uint64_t>(i);
        add_vertex(p.part);
        add_shared(p.part, 0, {name, name + 1}, i % 3 != 1);
    }
    const Numbers expected = by_one(parts);
    CHECK(expected.begin()->second.vertices == kParts + 1);
    std::vector<int> rank_of(kParts);
    for (int i = 0; i < kParts; ++i) {
        rank_of[static_cast<std::size_t>(i)] = i;
    }
    CHECK(by_ranks(kParts, parts, rank_of) == expected);
    CHECK(by_ranks(3, parts, {0, 1, 2, 0, 1, 2, 0, 1, 2}) == expected);
}

TEST_CASE("ranks without parts have an empty mesh") {
    CHECK(by_ranks(3, {}, {}).empty());
}
