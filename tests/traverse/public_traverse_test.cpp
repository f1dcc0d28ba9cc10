// <isonest/traverse.h>: the public traversal compared with recursive bisection in memory.
#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include <isonest/error.h>
#include <isonest/own_indicator.h>
#include <isonest/traverse.h>

#include "query/values/node_sampler.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail::test;

namespace {

using Path = std::vector<Int3>;

/// A leaf as found by hand or by the library.
struct Found {
    Path nodes;
    std::vector<double> values;
    int level = 0;
    int kind = 0;

    bool operator==(const Found& o) const {
        const auto same = [](double a, double b) { return a == b || (a != a && b != b); };
        return nodes == o.nodes && level == o.level && kind == o.kind &&
               std::equal(values.begin(), values.end(), o.values.begin(), o.values.end(), same);
    }
};

template <int D>
Found found(const Element<D>& t) {
    return {{t.v.begin(), t.v.end()}, {t.value.begin(), t.value.end()}, t.level, t.kind};
}

/// The nested grid by Maubach's rule on vectors of nodes; values and eta come from functions of the
/// node, without a store.
struct ByHand {
    Int3 nodes;
    std::function<double(const Int3&)> u;
    std::function<bool(const Path&, const Int3& ref_node, int level)> interest;
    std::function<bool(const Int3& ref_node)> stop;
    std::vector<Found> leaves = {};
    std::uint64_t visited = 0;

    void run() {
        std::vector<int> axes;
        std::int64_t cells = 0;
        for (int axis = 0; axis < 3; ++axis) {
            if (nodes[axis] > 1) {
                axes.push_back(axis);
                cells = std::max(cells, nodes[axis] - 1);
            }
        }
        int top = 0;
        while ((std::int64_t{1} << top) < cells) {
            ++top;
        }
        do {
            Path v(1);
            for (const int axis : axes) {
                v.push_back(v.back());
                v.back()[axis] += std::int64_t{1} << top;
            }
            visit(v, static_cast<int>(axes.size()), top, 0);
        } while (std::next_permutation(axes.begin(), axes.end()));
    }

  private:
    void visit(const Path& v, int dimension, int level, int kind) {
        Int3 low = v[0];
        for (const Int3& p : v) {
            low = min(low, p);
        }
        for (int axis = 0; axis < 3; ++axis) {
            if (nodes[axis] > 1 && low[axis] >= nodes[axis] - 1) {
                return;
            }
        }
        ++visited;
        const auto end = static_cast<std::size_t>(dimension - kind);
        const Int3 twice = v[0] + v[end];
        const Int3 middle{twice.x / 2, twice.y / 2, twice.z / 2};
        if (!interest(v, middle, level)) {
            return;
        }
        if (level == 0 || stop(middle)) {
            Found leaf{v, {}, level, kind};
            for (const Int3& p : v) {
                leaf.values.push_back(u(p));
            }
            leaves.push_back(leaf);
            return;
        }
        Path a = v;
        a[end] = middle;
        Path b = v;
        for (std::size_t i = 0; i < end; ++i) {
            b[i] = v[i + 1];
        }
        b[end] = middle;
        const int next = (kind + 1) % dimension;
        visit(a, dimension, next == 0 ? level - 1 : level, next);
        visit(b, dimension, next == 0 ? level - 1 : level, next);
    }
};

float hills(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.2 * noise(p));
}
float with_holes(const Int3& p) {
    return noise(p, 5) < 0.004 ? std::numeric_limits<float>::quiet_NaN() : hills(p);
}

struct Subject {
    Subject(const Int3& n, const std::function<float(const Int3&)>& f, int chunk = 8)
        : volume(n, f) {
        PreprocessOptions options = with_chunk(chunk, true);
        options.fields = {Field::linf_bar, Field::linf_plus, Field::deviation_bar};
        make_store(volume, folder / "s", options);
        store.emplace(folder / "s");
    }
    /// U, continued by the nearest node.
    [[nodiscard]] double at(const Int3& p) const {
        return volume.at(min(p, volume.nodes() - Int3{1, 1, 1}));
    }
    TemporaryFolder folder;
    FunctionVolume<float> volume;
    std::optional<Store> store;
};

/// Smaller for finer nodes: a saturated indicator that needs no store.
double eta_of(const Int3& p) {
    const std::int64_t bits = p.x | p.y | p.z;
    const auto scale = static_cast<double>(bits & -bits);
    return scale * scale;
}

bool same_set(std::vector<Found> a, std::vector<Found> b) {
    const auto less = [](const Found& l, const Found& r) {
        const auto key = [](const Found& f) {
            std::vector<std::int64_t> k;
            for (const Int3& p : f.nodes) {
                k.insert(k.end(), {p.x, p.y, p.z});
            }
            return k;
        };
        return key(l) < key(r);
    };
    std::sort(a.begin(), a.end(), less);
    std::sort(b.begin(), b.end(), less);
    return a == b;
}

/// The leaves of the library, in the order in which it reports them.
template <int D, class Interest, class Stop>
std::vector<Found> collect(const Store& store, const Interest& interest, const Stop& stop,
                           const TraverseOptions& options, TraverseReport* report = nullptr) {
    std::vector<Found> all;
    const auto result = adapt_traverse<D>(
        store, interest, stop, in_order<D>([&](const Element<D>& t) { all.push_back(found(t)); }),
        options);
    CHECK(result.leaves == all.size());
    if (report != nullptr) {
        *report = result;
    }
    return all;
}

template <int D>
void require_as_by_hand(const Int3& n) {
    CAPTURE(n.x, n.y, n.z);
    for (const auto& f : {hills, with_holes}) {
        const Subject subject(n, f);
        for (const double threshold : {0.0, 5.0, 1e9}) {
            CAPTURE(threshold);
            // Interest: away from a corner of the volume; stop: by the node alone.
            ByHand hand{n, [&](const Int3& p) { return subject.at(p); },
                        [](const Path& v, const Int3&, int) { return v[0].x + v[0].y != 6; },
                        [&](const Int3& p) { return eta_of(p) < threshold; }};
            hand.run();
            const auto interest = [](const Element<D>& t) { return t.v[0].x + t.v[0].y != 6; };
            const auto stop = [&](const Element<D>& t) { return eta_of(t.ref_node()) < threshold; };
            std::vector<Found> first;
            for (const int threads : {1, 2, 5}) {
                for (const std::uint64_t memory :
                     {std::uint64_t{100} << 20U, std::uint64_t{1} << 30U}) {
                    TraverseReport report;
                    const std::vector<Found> leaves =
                        collect<D>(*subject.store, interest, stop,
                                   {.memory = memory, .threads = threads}, &report);
                    CHECK(report.visited == hand.visited);
                    if (first.empty()) {
                        first = leaves;
                        CHECK(same_set(leaves, hand.leaves));
                    }
                    CHECK(leaves == first);
                }
                // Concurrent calls give the same set.
                std::vector<Found> any;
                std::mutex mutex;
                adapt_traverse<D>(*subject.store, interest, stop,
                                  [&](const Element<D>& t) {
                                      const std::lock_guard lock(mutex);
                                      any.push_back(found(t));
                                  },
                                  {.threads = threads});
                CHECK(same_set(any, hand.leaves));
            }
        }
    }
}

}  // namespace

TEST_CASE("the leaves for the caller's tests are those of recursive bisection by hand") {
    for (const Int3& n :
         {Int3{2, 2, 2}, Int3{9, 9, 9}, Int3{12, 17, 6}, Int3{3, 2, 21}, Int3{20, 35, 18}}) {
        require_as_by_hand<3>(n);
    }
    for (const Int3& n : {Int3{2, 2, 1}, Int3{33, 33, 1}, Int3{20, 1, 37}, Int3{1, 150, 3}}) {
        require_as_by_hand<2>(n);
    }
    for (const Int3& n : {Int3{1, 1, 2}, Int3{65, 1, 1}, Int3{1, 100, 1}, Int3{9000, 1, 1}}) {
        require_as_by_hand<1>(n);
    }
}

namespace {

/// A sum whose rounding depends on the order of the terms.
struct Sum {
    double total = 0;
    template <int D>
    void operator()(const Element<D>& t) {
        for (const double value : t.value) {
            total += std::isfinite(value) ? value * static_cast<double>(t.size()) / 3 : 0;
        }
    }
    [[nodiscard]] Sum fork() const { return {}; }
    void join(const Sum& part) { total += part.total; }
};

struct Cancelled : Progress {
    std::atomic<int> left{0};
    std::atomic<bool> stopped{false};
    void advance(std::uint64_t) override { stopped = stopped || --left < 0; }
    [[nodiscard]] bool cancelled() const override { return stopped; }
};

struct Oops {};

}  // namespace

TEST_CASE("indicators are those of the store at the refinement node, 0 in the finest grid") {
    const Subject subject({21, 34, 19}, with_holes);
    detail::ChunkCache cache(subject.store->reader(), 1U << 24U);
    detail::NodeSampler sampler(cache);
    std::size_t compared = 0;
    std::size_t wrong = 0;
    // Three fields: one more than are held at a time.
    const auto check = [&](const Element<3>& t, const Indicators& eta) {
        for (const Field field : {Field::linf_bar, Field::linf_plus, Field::deviation_bar}) {
            const double expected = t.level == 0 ? 0 : sampler.indicator(t.ref_node(), field);
            wrong += eta(field) == expected ? 0 : 1;
            ++compared;
        }
        return t.level == 1 && t.v[0].x % 4 == 0;
    };
    adapt_traverse<3>(*subject.store,
                      [&](const Element<3>& t, const Indicators& eta) {
                          check(t, eta);
                          return true;
                      },
                      check, check, {.threads = 1});
    CHECK(compared > 10000);
    CHECK(wrong == 0);
}

TEST_CASE("the ready-made tests are those of section 5") {
    const Subject subject({33, 26, 40}, hills);
    const double iso = 0.6;
    const MayHoldIsovalue interest = may_hold_isovalue(*subject.store, iso);
    CHECK(interest.bound == Field::deviation_bar);
    const StopBelow stop = stop_below(*subject.store, ErrorBound{.value = 0.2});
    CHECK(stop.field == Field::deviation_bar);
    CHECK(stop.threshold == 0.2);
    const auto by_hand = collect<3>(
        *subject.store,
        [&](const Element<3>& t, const Indicators& eta) {
            const auto [low, high] = t.range();
            const double beta = eta(Field::deviation_bar);
            return low - beta <= iso && high + beta >= iso;
        },
        [](const Element<3>&, const Indicators& eta) { return eta(Field::deviation_bar) < 0.2; },
        {});
    CHECK(by_hand.size() > 100);
    CHECK(collect<3>(*subject.store, interest, stop, {}) == by_hand);
    // No cell with the isovalue is outside of the leaves: they are found at full resolution.
    const auto finest = collect<3>(*subject.store, interest, FullResolution(), {});
    const auto all = collect<3>(*subject.store, Everywhere(), FullResolution(), {});
    const auto holds = [&](const Found& f) {
        const auto [low, high] = std::minmax_element(f.values.begin(), f.values.end());
        return *low <= iso && *high >= iso;
    };
    CHECK(std::count_if(all.begin(), all.end(), holds) == std::ssize(finest));
}

TEST_CASE("the sizes of the leaves add up to the volume, in any placement") {
    for (const Int3& n : {Int3{33, 33, 33}, Int3{17, 9, 33}, Int3{65, 33, 1}, Int3{1, 129, 1}}) {
        const Subject subject(n, hills);
        double size = 0;
        double corners = 0;
        const Placement placement(*subject.store);
        const auto add = [&](const auto& t) {
            size += placement.size(t);
            corners += placement(t)[0][0];
        };
        const StopBelow stop = stop_below(*subject.store, ErrorBound{.value = 0.3});
        const int dimension = dimension_of(*subject.store);
        std::uint64_t leaves = 0;
        if (dimension == 3) {
            leaves = for_each_leaf<3>(*subject.store, stop, in_order<3>(add)).leaves;
        } else if (dimension == 2) {
            leaves = for_each_leaf<2>(*subject.store, stop, in_order<2>(add)).leaves;
        } else {
            leaves = for_each_leaf<1>(*subject.store, stop, in_order<1>(add)).leaves;
        }
        CHECK(leaves >= 4);
        const Int3 cells = max(n - Int3{1, 1, 1}, {1, 1, 1});
        const Double3 spacing = subject.store->spacing();
        double expected = 1;
        for (int axis = 0; axis < 3; ++axis) {
            expected *= n[axis] > 1 ? static_cast<double>(cells[axis]) *
                                          spacing[static_cast<std::size_t>(axis)]
                                    : 1;
        }
        CHECK(size == Approx(expected).epsilon(1e-12));
        CHECK(std::isfinite(corners));
    }
}

TEST_CASE("positions and sizes of elements are those of a rotated and sheared volume") {
    const TemporaryFolder folder;
    const Int3 n{9, 5, 7};
    const Directions direction{{{0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0.6, 0.8}}};
    const Double3 spacing{0.5, 2, 1.5};
    const Double3 origin{10, -3, 7};
    struct Placed : FunctionVolume<float> {
        using FunctionVolume::FunctionVolume;
        VolumeDescription description;
        [[nodiscard]] VolumeDescription describe() const override { return description; }
    };
    Placed volume(n, hills);
    volume.description = volume.FunctionVolume::describe();
    volume.description.spacing = spacing;
    volume.description.origin = origin;
    volume.description.direction = direction;
    make_store(volume, folder / "s", with_chunk(8, true));
    const Store store(folder / "s");
    const Placement placement(store);
    std::size_t wrong = 0;
    std::size_t count = 0;
    for_each_leaf<3>(store, FullResolution(), in_order<3>([&](const Element<3>& t) {
                         const auto corners = placement(t);
                         std::array<Double3, 3> edge{};
                         for (std::size_t i = 0; i < 4; ++i) {
                             for (std::size_t w = 0; w < 3; ++w) {
                                 double expected = origin[w];
                                 for (int a = 0; a < 3; ++a) {
                                     const auto axis = static_cast<std::size_t>(a);
                                     expected += direction[axis][w] * spacing[axis] *
                                                 static_cast<double>(t.v[i][a]);
                                 }
                                 wrong += std::fabs(corners[i][w] - expected) < 1e-12 ? 0 : 1;
                                 if (i > 0) {
                                     edge[i - 1][w] = corners[i][w] - corners[0][w];
                                 }
                             }
                         }
                         const double volume_of =
                             std::fabs(detail::dot(edge[0], detail::cross(edge[1], edge[2]))) / 6;
                         wrong += std::fabs(placement.size(t) - volume_of) < 1e-12 ? 0 : 1;
                         ++count;
                     }));
    CHECK(count == 6U * 8 * 4 * 6);
    CHECK(wrong == 0);
}

TEST_CASE("the elements of a volume with uneven axes fill it, with corners at the coordinates") {
    const TemporaryFolder folder;
    const Int3 n{17, 9, 33};
    struct Uneven : FunctionVolume<float> {
        using FunctionVolume::FunctionVolume;
        VolumeDescription description;
        [[nodiscard]] VolumeDescription describe() const override { return description; }
    };
    Uneven volume(n, hills);
    auto axes = std::make_shared<UnevenAxes>();
    for (const std::size_t axis : {std::size_t{0}, std::size_t{2}}) {
        for (std::int64_t i = 0; i < n[static_cast<int>(axis)]; ++i) {
            const auto x = static_cast<double>(i);
            axes->offsets.at(axis).push_back(x * (1 + x / 8));
        }
    }
    volume.description = volume.FunctionVolume::describe();
    volume.description.origin = {-5, 7, 100};
    volume.description.spacing = {axes->offsets[0].back() / 16, 0.5, axes->offsets[2].back() / 32};
    volume.description.uneven = axes;
    make_store(volume, folder / "s", with_chunk(8, true));
    const Store store(folder / "s");
    REQUIRE(store.uneven_axes() != nullptr);
    CHECK(*store.uneven_axes() == *axes);
    const Placement placement(store);
    const auto coordinate = [&](std::size_t axis, std::int64_t node) {
        return volume.description.origin.at(axis) +
               (axis == 1 ? 0.5 * static_cast<double>(node)
                          : axes->offsets.at(axis).at(static_cast<std::size_t>(node)));
    };
    for (const double error : {0.0, 0.3}) {
        double size = 0;
        std::size_t wrong = 0;
        std::size_t count = 0;
        for_each_leaf<3>(
            store, stop_below(store, ErrorBound{.value = error}),
            in_order<3>([&](const Element<3>& t) {
                const auto corners = placement(t);
                for (std::size_t i = 0; i < 4; ++i) {
                    for (std::size_t axis = 0; axis < 3; ++axis) {
                        const double expected = coordinate(axis, t.v[i][static_cast<int>(axis)]);
                        wrong += std::fabs(corners[i][axis] - expected) < 1e-12 * 200 ? 0 : 1;
                    }
                }
                size += placement.size(t);
                ++count;
            }));
        CHECK(wrong == 0);
        CHECK(count > 100);
        CHECK(size == Approx(axes->offsets[0].back() * 4 * axes->offsets[2].back()).epsilon(1e-12));
    }
}

TEST_CASE("joined actions give the same sum to the last bit for any threads and memory") {
    const Subject subject({70, 67, 80}, with_holes, 16);
    const StopBelow stop = stop_below(*subject.store, ErrorBound{.value = 0.1});
    std::optional<double> first;
    for (const int threads : {1, 2, 7}) {
        for (const std::uint64_t memory : {std::uint64_t{150} << 20U, std::uint64_t{1} << 30U}) {
            Sum sum;
            for_each_leaf<3>(*subject.store, stop, sum, {.memory = memory, .threads = threads});
            CHECK(sum.total != 0);
            first = first.value_or(sum.total);
            CHECK(sum.total == *first);
        }
    }
}

TEST_CASE("only elements that overlap the box are visited") {
    const Subject subject({40, 33, 37}, hills);
    const WorldBox box{{3.5, 4, 7}, {12, 9.25, 8}};
    const auto inside = collect<3>(*subject.store, Everywhere(), FullResolution(), {.box = box});
    auto all = collect<3>(*subject.store, Everywhere(), FullResolution(), {});
    const auto misses = [&](const Found& f) {
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            std::int64_t low = f.nodes[0][axis];
            std::int64_t high = low;
            for (const Int3& p : f.nodes) {
                low = std::min(low, p[axis]);
                high = std::max(high, p[axis]);
            }
            if (static_cast<double>(high) <= box.lo[a] || static_cast<double>(low) >= box.hi[a]) {
                return true;
            }
        }
        return false;
    };
    all.erase(std::remove_if(all.begin(), all.end(), misses), all.end());
    CHECK(inside == all);
    CHECK(inside.size() == 6U * 9 * 6 * 1);
    CHECK_THROWS_AS(collect<3>(*subject.store, Everywhere(), FullResolution(),
                               {.box = WorldBox{{1, 1, 1}, {0, 2, 2}}}),
                    Error);
}

TEST_CASE("errors of the caller's functions and a cancellation end a traversal") {
    const Subject subject({70, 67, 80}, hills, 16);
    const Store& store = *subject.store;
    const auto nothing = [](const Element<3>&) {};
    const auto deep = [](const Element<3>& t) {
        if (t.level == 0) {
            throw Oops();
        }
        return true;
    };
    for (const int threads : {1, 2}) {
        const TraverseOptions options{.threads = threads};
        CHECK_THROWS_AS(adapt_traverse<3>(store, deep, FullResolution(), nothing, options), Oops);
        const auto stop = [](const Element<3>& t) -> bool {
            return t.level == 2 ? throw Oops() : false;
        };
        CHECK_THROWS_AS(for_each_leaf<3>(store, stop, nothing, options), Oops);
        std::atomic<int> count{0};
        const auto action = [&](const Element<3>&) {
            if (++count == 1000) {
                throw Oops();
            }
        };
        CHECK_THROWS_AS(for_each_leaf<3>(store, FullResolution(), action, options), Oops);
        count = 0;
        CHECK_THROWS_AS(for_each_leaf<3>(store, FullResolution(), in_order<3>(action), options),
                        Oops);
        CHECK(count == 1000);
        for (const int steps : {0, 3}) {
            Cancelled progress;
            progress.left = steps;
            try {
                for_each_leaf<3>(store, FullResolution(), nothing, options, progress);
                FAIL("was not cancelled");
            } catch (const Error& error) {
                CHECK(error.kind() == ErrorKind::cancelled);
            }
        }
    }
}

TEST_CASE("an own indicator stops a traversal as the built-in one with its formula does") {
    // Fields of own indicators have numbers that grow with the names that a process meets.
    for (int i = 0; i < 40; ++i) {
        own_field("other" + std::to_string(i), Saturation::bar);
    }
    const TemporaryFolder folder;
    FunctionVolume<float> volume({17, 20, 12},
                                 [](const Int3& p) { return static_cast<float>(noise(p)); });
    PreprocessOptions options = with_chunk(8);
    options.exact = true;
    options.own = {
        own_indicator("offset", [](const RefinementNode& x) { return std::fabs(x.offset()); })};
    make_store(volume, folder / "s", options);
    const Store store(folder / "s");
    for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
        const auto leaves = [&](Field field) {
            std::vector<Found> all;
            // Not near a number: those of linf on level 1 are computed, not rounded up.
            for_each_leaf<3>(store, StopBelow{field, 0.37},
                             in_order<3>([&](const Element<3>& t) { all.push_back(found(t)); }));
            return all;
        };
        const std::vector<Found> expected = leaves(field_of(Indicator::linf, saturation));
        CHECK(expected.size() > 1000);
        const bool same = leaves(own_field("offset", saturation)) == expected;
        CHECK(same);
    }
}

TEST_CASE("what a traversal cannot do is refused with its kind") {
    const Subject subject({9, 9, 1}, hills);
    const auto nothing = [](const auto&) {};
    const auto kind_of = [](const auto& call) {
        try {
            call();
        } catch (const Error& error) {
            return std::optional(error.kind());
        }
        return std::optional<ErrorKind>();
    };
    const Store& store = *subject.store;
    CHECK(kind_of([&] { for_each_leaf<3>(store, FullResolution(), nothing); }) ==
          ErrorKind::invalid_argument);
    CHECK(kind_of([&] {
              for_each_leaf<2>(store, StopBelow{Field::l2_bar, 1}, nothing);
          }) == ErrorKind::not_found);
    CHECK(kind_of([&] {
              for_each_leaf<2>(store, StopBelow{Field::values, 1}, nothing);
          }) == ErrorKind::invalid_argument);
    CHECK(kind_of([&] {
              for_each_leaf<2>(store, StopBelow{Field::hex_linf, 1}, nothing);
          }) == ErrorKind::invalid_argument);
    CHECK(kind_of([&] {
              for_each_leaf<2>(store, FullResolution(), nothing, {.memory = 1U << 20U});
          }) == ErrorKind::limit);
}
