// The leaves of a whole domain compared with the finest grid, and in parallel.
#include "query/traverse/each_leaf.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <map>
#include <mutex>

#include "tests/support/leaf_sets.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// The leaves by the parallel traversal; they and their order are the same for any number of
/// threads.
template <int D>
Leaves by_each_leaf(const Subject& subject, double threshold) {
    const StopsBelow stop{below(threshold), kStop};
    std::map<std::uint64_t, std::vector<Key>> first;
    for (const int threads : {1, 4}) {
        ChunkCache cache(*subject.store, threads == 1 ? 1U << 12U : 1U << 22U);
        std::map<std::uint64_t, std::vector<Key>> found;
        std::mutex mutex;
        const LeafSink<D> sink = [&](std::uint64_t order, std::span<const DomainLeaf<D>> leaves) {
            const std::lock_guard lock(mutex);
            for (const DomainLeaf<D>& leaf : leaves) {
                found[order].push_back(key_of(leaf.element.v));
            }
        };
        for_each_leaf<D>(cache, stop, volume_box(subject.lattice()), sink, threads,
                         silent_progress());
        if (threads == 1) {
            first = found;
        }
        CHECK(found == first);
    }
    Leaves all;
    for (const auto& [order, leaves] : first) {
        all.insert(leaves.begin(), leaves.end());
    }
    return all;
}

/// Bisects leaves down to the finest grid: every finest element that begins inside the volume
/// occurs exactly once. And there are no hanging vertices: the midpoint of a leaf's edge, where the
/// first one would be, is not a vertex of a leaf.
template <int D>
void require_tiling(const Leaves& leaves, const Subject& subject, double threshold) {
    const Int3 n = subject.volume.nodes();
    ChunkCache cache(*subject.store, 1U << 22U);
    std::multiset<Key> finest;
    std::set<std::array<std::int64_t, 3>> vertices;
    std::uint64_t size = 0;
    const LeafSink<D> sink = [&](std::uint64_t, std::span<const DomainLeaf<D>> batch) {
        for (const DomainLeaf<D>& leaf : batch) {
            size += leaf.element.size();
            for (const Int3& p : leaf.element.v) {
                vertices.insert({p.x, p.y, p.z});
            }
            const std::function<void(const Element<D>&)> split = [&](const Element<D>& t) {
                if (t.level > 0) {
                    for (const Element<D>& half : t.bisect(0)) {
                        split(half);
                    }
                } else if (InBox{volume_box(subject.lattice())}.overlap(t) != Overlap::outside) {
                    finest.insert(key_of(t.v));
                }
            };
            split(leaf.element);
        }
    };
    for_each_leaf<D>(cache, StopsBelow{below(threshold), kStop}, volume_box(subject.lattice()),
                     sink, 1, silent_progress());
    const std::set<Key> once(finest.begin(), finest.end());
    CHECK(once.size() == finest.size());
    const Int3 cells = max(n - Int3{1, 1, 1}, {1, 1, 1});
    constexpr std::uint64_t kInCell = D == 3 ? 6 : D;
    CHECK(finest.size() == kInCell * static_cast<std::uint64_t>(cells.product()));
    CHECK(size >= finest.size());
    if (cells == subject.lattice().elements_at(subject.lattice().top()) *
                     (std::int64_t{1} << subject.lattice().top())) {
        CHECK(size == finest.size());
    }
    std::size_t hanging = 0;
    for (const Key& key : leaves) {
        for (std::size_t i = 0; i < key.size(); ++i) {
            for (std::size_t j = 0; j < i; ++j) {
                std::array<std::int64_t, 3> middle{};
                bool is_node = true;
                for (std::size_t a = 0; a < 3; ++a) {
                    middle[a] = (key[i][a] + key[j][a]) / 2;
                    is_node = is_node && (key[i][a] + key[j][a]) % 2 == 0;
                }
                hanging += is_node && vertices.contains(middle) ? 1 : 0;
            }
        }
    }
    CHECK(hanging == 0);
}

/// Sizes that are and are not 2^k + 1, with and without missing values.
template <int D>
void require_whole_domain(const Int3& n) {
    CAPTURE(n.x, n.y, n.z);
    for (const auto& f : {hills, with_holes}) {
        const Subject subject(n, f);
        for (const double threshold : {0.0, 0.15, 0.6, 1e9}) {
            CAPTURE(threshold);
            const Leaves leaves = by_each_leaf<D>(subject, threshold);
            CHECK(leaves == by_traversal<D>(subject, Everything{}, threshold));
            require_tiling<D>(leaves, subject, threshold);
        }
    }
}

}  // namespace

TEST_CASE("the leaves of a volume tile it without gaps, overlaps or hanging nodes") {
    for (const Int3& n : {Int3{2, 2, 2}, Int3{9, 9, 9}, Int3{17, 17, 17}, Int3{12, 17, 6},
                          Int3{3, 2, 21}, Int3{2, 19, 4}, Int3{35, 20, 40}}) {
        require_whole_domain<3>(n);
    }
}

TEST_CASE("the leaves of a plane or a line tile it without gaps, overlaps or hanging nodes") {
    for (const Int3& n :
         {Int3{2, 2, 1}, Int3{33, 33, 1}, Int3{20, 1, 37}, Int3{1, 50, 3}, Int3{2, 300, 1}}) {
        require_whole_domain<2>(n);
    }
    for (const Int3& n : {Int3{1, 1, 2}, Int3{65, 1, 1}, Int3{1, 100, 1}}) {
        require_whole_domain<1>(n);
    }
}

TEST_CASE("a domain of many tasks gives each finest element once, always in the same order") {
    const Int3 n{70, 67, 80};  // divided twice into cubes, starting from the coarsest
    const Subject subject(n, hills, 16);
    const Leaves all = by_each_leaf<3>(subject, 0);
    CHECK(all.size() == 6U * 69 * 66 * 79);
    CHECK(std::set<Key>(all.begin(), all.end()).size() == all.size());
    const Leaves some = by_each_leaf<3>(subject, 0.4);
    CHECK(some == by_traversal<3>(subject, Everything{}, 0.4));
    CHECK(some.size() < all.size());
}

TEST_CASE("only leaves that extend into the box are reported") {
    const Subject subject({40, 33, 37}, hills);
    ChunkCache cache(*subject.store, 1U << 22U);
    const ClipBox box{{7.5, 3, 10}, {20, 9.25, 30}};
    const StopsBelow stop{below(0.3), kStop};
    Leaves expected;
    Leaves cut;
    Leaves found;
    Leaves found_cut;
    const LeafSink<3> whole = [&](std::uint64_t, std::span<const DomainLeaf<3>> leaves) {
        for (const DomainLeaf<3>& leaf : leaves) {
            CHECK((leaf.eta < 0.3));
            const Overlap overlap = InBox{box}.overlap(leaf.element);
            if (overlap != Overlap::outside) {
                expected.insert(key_of(leaf.element.v));
            }
            if (overlap == Overlap::crossing) {
                cut.insert(key_of(leaf.element.v));
            }
        }
    };
    const LeafSink<3> boxed = [&](std::uint64_t, std::span<const DomainLeaf<3>> leaves) {
        CHECK(leaves.size() <= kLeavesPerBatch);
        for (const DomainLeaf<3>& leaf : leaves) {
            found.insert(key_of(leaf.element.v));
            if (leaf.cut) {
                found_cut.insert(key_of(leaf.element.v));
            }
        }
    };
    for_each_leaf<3>(cache, stop, volume_box(subject.lattice()), whole, 1, silent_progress());
    for_each_leaf<3>(cache, stop, box, boxed, 1, silent_progress());
    CHECK(!found.empty());
    CHECK(found == expected);
    CHECK(found_cut == cut);
}

TEST_CASE("progress over the whole domain adds up, and exceptions of the sink reach the caller") {
    class Sum : public Progress {
      public:
        void begin(std::string_view, std::uint64_t total, std::string_view) override {
            total_ = total;
        }
        void advance(std::uint64_t amount) override { sum_ += amount; }
        std::uint64_t total_ = 0;
        std::atomic<std::uint64_t> sum_ = 0;
    };
    const Subject subject({70, 35, 80}, hills, 16);
    ChunkCache cache(*subject.store, 1U << 22U);
    Sum progress;
    const LeafSink<3> nothing = [](std::uint64_t, std::span<const DomainLeaf<3>>) {};
    for_each_leaf<3>(cache, StopsBelow{below(0.3), kStop}, volume_box(subject.lattice()), nothing,
                     2, progress);
    CHECK(progress.total_ > 0);
    CHECK(progress.sum_ == progress.total_);
    struct Enough {};
    const LeafSink<3> refuse = [](std::uint64_t, std::span<const DomainLeaf<3>>) {
        throw Enough{};
    };
    CHECK_THROWS_AS(for_each_leaf<3>(cache, NothingStops{}, volume_box(subject.lattice()), refuse,
                                     2, silent_progress()),
                    Enough);
}
