// AdaptTraverse compared with an explicit bisection and with the fast path for volumes.
#include "query/traverse/adapt_traverse.h"

#include <catch2/catch.hpp>
#include <mutex>

#include "query/traverse/traversal.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/leaf_sets.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// The leaves of an explicit bisection: Maubach's tags, the oracle's indicators, no closed form.
template <int D>
class ByHand {
  public:
    ByHand(const Subject& subject, const BisectionOracle& oracle, double threshold)
        : volume_(subject.volume), oracle_(oracle), threshold_(threshold) {
        std::vector<int> axes;
        for (int axis = 0; axis < 3; ++axis) {
            if (volume_.nodes()[axis] > 1) {
                axes.push_back(axis);
            }
        }
        do {
            std::vector<Int3> v(1);
            for (const int axis : axes) {
                v.push_back(v.back());
                v.back()[axis] += std::int64_t{1} << subject.lattice().top();
            }
            roots_.push_back(v);
        } while (std::next_permutation(axes.begin(), axes.end()));
    }
    /// All leaves that extend into the volume; with an isovalue only those that may contain it.
    Leaves leaves(std::optional<double> iso) {
        iso_ = iso;
        leaves_.clear();
        for (const auto& v : roots_) {
            visit(v, D);
        }
        return leaves_;
    }

  private:
    /// REQUIRES: v0 v(tag) is the refinement edge.
    void visit(const std::vector<Int3>& v, std::size_t tag) {
        Int3 low = v[0];
        Int3 high = v[0];
        double least = volume_.at(v[0]);
        double most = least;
        for (const Int3& p : v) {
            low = min(low, p);
            high = max(high, p);
            least = std::min(least, volume_.at(p));
            most = std::max(most, volume_.at(p));
        }
        const Int3 n = volume_.nodes();
        for (int axis = 0; axis < 3; ++axis) {
            if (n[axis] > 1 && low[axis] >= n[axis] - 1) {
                return;
            }
        }
        const Int3 size = high - low;
        const bool finest = std::max({size.x, size.y, size.z}) == 1;
        const Int3 twice = v[0] + v[tag];
        const Int3 x{twice.x / 2, twice.y / 2, twice.z / 2};
        const OracleNode node = finest ? OracleNode{} : oracle_.nodes().at({x.x, x.y, x.z});
        const double bound = finest ? 0 : node.of(Field::linf_plus);
        if (iso_ && (least - bound > *iso_ || most + bound < *iso_)) {
            return;
        }
        if (finest || node.of(Field::linf_bar) < threshold_) {
            leaves_.insert(key_of(v));
            return;
        }
        std::vector<Int3> a = v;
        std::vector<Int3> b = v;
        for (std::size_t i = 0; i < tag; ++i) {
            b[i] = v[i + 1];
        }
        a[tag] = b[tag] = x;
        visit(a, tag == 1 ? D : tag - 1);
        visit(b, tag == 1 ? D : tag - 1);
    }

    const FunctionVolume<float>& volume_;
    const BisectionOracle& oracle_;
    double threshold_;
    std::optional<double> iso_;
    std::vector<std::vector<Int3>> roots_;
    Leaves leaves_;
};

/// By cubes and bricks.
Leaves by_fast_path(const Subject& subject, double iso, double threshold, Field bound) {
    ChunkCache cache(*subject.store, 1U << 22U);
    TraversalQuery query;
    query.iso = iso;
    query.tolerance = below(threshold);
    query.stop = kStop;
    query.bound = bound;
    query.box = volume_box(subject.lattice());
    Leaves leaves;
    std::mutex mutex;
    query.on_leaf = [&](const Leaf& leaf) {
        std::vector<Int3> nodes;
        for (const Corner& corner : leaf.corners) {
            nodes.push_back(corner.node);
        }
        const std::lock_guard lock(mutex);
        leaves.insert(key_of(nodes));
    };
    traverse(
        cache, query, 4096, [](std::uint64_t, const MeshPart&) {}, silent_progress());
    return leaves;
}

/// The leaves that a surface really crosses: values on both sides, none missing, partly inside the
/// volume. Which other leaves a traversal visits depends on how early it detects that they are not
/// needed.
Leaves crossed(const Leaves& leaves, const FunctionVolume<float>& volume, double iso) {
    Leaves out;
    const Int3 last = volume.nodes() - Int3{1, 1, 1};
    for (const Key& key : leaves) {
        bool missing = false;
        bool below_it = false;
        bool not_below = false;
        Int3 low{key[0][0], key[0][1], key[0][2]};
        for (const auto& v : key) {
            const Int3 p{v[0], v[1], v[2]};
            const double u = volume.at(p);
            low = min(low, p);
            missing = missing || !std::isfinite(u);
            below_it = below_it || u < iso;
            not_below = not_below || u >= iso;
        }
        const bool inside = low.x < last.x && low.y < last.y && low.z < last.z;
        if (!missing && below_it && not_below && inside) {
            out.insert(key);
        }
    }
    return out;
}

/// The leaves without a missing value: for others the interest test may have either result.
Leaves complete(const Leaves& leaves, const FunctionVolume<float>& volume) {
    Leaves out;
    for (const Key& key : leaves) {
        if (std::all_of(key.begin(), key.end(), [&](const auto& v) {
                return std::isfinite(volume.at({v[0], v[1], v[2]}));
            })) {
            out.insert(key);
        }
    }
    return out;
}

template <int D>
void require_same_leaves(const Int3& n, const std::function<float(const Int3&)>& f) {
    CAPTURE(n.x, n.y, n.z);
    const Subject subject(n, f);
    const BisectionOracle oracle(n, [&](const Int3& p) { return subject.volume.at(p); });
    for (const double threshold : {0.0, 0.15, 0.6, 1e9}) {
        CAPTURE(threshold);
        ByHand<D> by_hand(subject, oracle, threshold);
        CHECK(by_traversal<D>(subject, Everything{}, threshold) == by_hand.leaves(std::nullopt));
        for (const double iso : {0.1, 0.7}) {
            CAPTURE(iso);
            const HoldsIsovalue by_sum{iso, Field::linf_plus};
            CHECK(complete(by_traversal<D>(subject, by_sum, threshold), subject.volume) ==
                  complete(by_hand.leaves(iso), subject.volume));
            if constexpr (D == 3) {
                for (const Field bound : {Field::linf_plus, Field::deviation_bar}) {
                    const HoldsIsovalue interest{iso, bound};
                    const Leaves fast = by_fast_path(subject, iso, threshold, bound);
                    CHECK(crossed(fast, subject.volume, iso) ==
                          crossed(by_traversal<D>(subject, interest, threshold), subject.volume,
                                  iso));
                }
            }
        }
    }
}

}  // namespace

TEST_CASE(
    "for volumes of any size the leaves are those of explicit bisection and of the fast path") {
    for (const Int3& n : {Int3{2, 2, 2}, Int3{9, 9, 9}, Int3{17, 17, 17}, Int3{12, 17, 6},
                          Int3{3, 2, 21}, Int3{2, 19, 4}}) {
        require_same_leaves<3>(n, hills);
        require_same_leaves<3>(n, with_holes);
    }
}

TEST_CASE("for planes of any size the leaves are those of explicit bisection") {
    for (const Int3& n :
         {Int3{2, 2, 1}, Int3{33, 33, 1}, Int3{20, 1, 37}, Int3{1, 50, 3}, Int3{2, 300, 1}}) {
        require_same_leaves<2>(n, hills);
        require_same_leaves<2>(n, with_holes);
    }
}

TEST_CASE("for lines of any size the leaves are those of explicit bisection") {
    for (const Int3& n : {Int3{1, 1, 2}, Int3{65, 1, 1}, Int3{1, 100, 1}}) {
        require_same_leaves<1>(n, hills);
        require_same_leaves<1>(n, with_holes);
    }
}
