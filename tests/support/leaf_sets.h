// Sets of leaves that can be compared.
#pragma once

#include <catch2/catch.hpp>
#include <optional>
#include <set>

#include "query/traverse/adapt_traverse.h"
#include "query/values/node_sampler.h"
#include "tests/support/test_support.h"

namespace isonest::detail::test {

/// Stored exactly as defined, so that an explicit bisection finds the same numbers.
inline constexpr Field kStop = Field::linf_bar;

/// A leaf by its sorted vertices.
using Key = std::vector<std::array<std::int64_t, 3>>;
using Leaves = std::multiset<Key>;

template <class Nodes>
Key key_of(const Nodes& nodes) {
    Key key;
    for (const Int3& p : nodes) {
        key.push_back({p.x, p.y, p.z});
    }
    std::sort(key.begin(), key.end());
    return key;
}

/// A volume and its store.
struct Subject {
    Subject(const Int3& n, const std::function<float(const Int3&)>& f, int chunk = 8)
        : volume(n, f) {
        PreprocessOptions options = with_chunk(chunk, true);
        options.fields = {Field::linf_bar, Field::linf_plus, Field::deviation_bar};
        make_store(volume, folder / "s", options);
        store.emplace(folder / "s");
    }
    [[nodiscard]] const Lattice& lattice() const { return store->layout().lattice(); }
    TemporaryFolder folder;
    FunctionVolume<float> volume;
    std::optional<StoreReader> store;
};

inline Tolerance below(double threshold) {
    return {threshold, {}, {}, {}, {}};
}

/// The leaves for one interest test, by AdaptTraverse in one thread.
template <int D, class Interest>
Leaves by_traversal(const Subject& subject, const Interest& interest, double threshold) {
    ChunkCache cache(*subject.store, 1U << 22U);
    NodeSampler numbers(cache);
    AdaptTraverse<Element<D>, NodeSampler, InBox, Interest, StopsBelow> traversal(
        numbers, InBox{volume_box(subject.lattice())}, interest,
        StopsBelow{below(threshold), kStop});
    Leaves leaves;
    std::size_t wrong_values = 0;
    auto collect = [&](const Element<D>& leaf, double eta, Overlap /*where*/) {
        leaves.insert(key_of(leaf.v));
        wrong_values += leaf.level > 0 && !(eta < threshold) ? 1 : 0;
        for (std::size_t i = 0; i < leaf.v.size(); ++i) {
            const double u = subject.volume.at(leaf.v[i]);
            wrong_values += leaf.value[i] != u && !(std::isnan(u) && std::isnan(leaf.value[i]));
        }
    };
    std::uint64_t whole = 0;
    for (const Element<D>& t : traversal.roots(subject.lattice())) {
        traversal.subtree(t, collect);
        whole += t.size();
    }
    CHECK(wrong_values == 0);
    CHECK(traversal.counts().leaves == leaves.size());
    CHECK(traversal.counts().visited >= leaves.size());
    CHECK(traversal.counts().finished == whole);
    return leaves;
}

inline float hills(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.2 * noise(p));
}

inline float with_holes(const Int3& p) {
    return noise(p, 5) < 0.004 ? std::numeric_limits<float>::quiet_NaN() : hills(p);
}

}  // namespace isonest::detail::test
