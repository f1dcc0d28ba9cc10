// Indicators of the caller: stored like the library's own for the same formula, and as an explicit
// bisection says for others.
#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/memory_volume.h>
#include <isonest/own_indicator.h>

#include "query/check/check.h"
#include "query/values/node_sampler.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/container/reader.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/rank_runs.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

OwnIndicator offset_indicator() {
    return own_indicator(
        "offset", [](const RefinementNode& x) { return std::fabs(x.offset()); }, "offset 1");
}

/// The largest difference of two values in an element.
OwnIndicator spread_indicator() {
    return own_indicator("spread", [](const RefinementNode& x) {
        double most = 0;
        for (const RefinedElement& t : x.elements) {
            const auto values = std::span(t.values).first(static_cast<std::size_t>(t.count));
            const auto [low, high] = std::minmax_element(values.begin(), values.end());
            most = std::max(most, *high - *low);
        }
        return most;
    });
}

PreprocessOptions with_own(int chunk, bool exact, std::vector<OwnIndicator> own) {
    PreprocessOptions options = with_chunk(chunk, exact);
    options.own = std::move(own);
    return options;
}

std::string bytes_of(const StoreReader& store, const ArrayInfo& array, const Int3& chunk) {
    const HeldBytes held = store.stored(array, chunk);
    return {reinterpret_cast<const char*>(held.bytes().data()), held.bytes().size()};
}

/// Compares own:offset with linf: chunks byte by byte; at level 1, where linf has only the centres,
/// those.
template <class T>
void require_same_as_linf(const Int3& n, const std::function<T(const Int3&)>& f, int chunk,
                          bool exact) {
    CAPTURE(n.x, n.y, n.z, chunk, exact);
    const TemporaryFolder folder;
    FunctionVolume<T> volume(n, f);
    make_store(volume, folder / "s", with_own(chunk, exact, {offset_indicator()}));
    const StoreReader store(folder / "s");
    const StoreLayout& layout = store.layout();
    CHECK(check(store, {.depth = CheckDepth::deep}, silent_progress()).failures == 0);
    std::size_t compared = 0;
    std::size_t wrong = 0;
    for (int level = 1; level <= layout.lattice().top(); ++level) {
        for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
            const ArrayInfo& own = layout.array(level, own_field("offset", saturation));
            const ArrayInfo& linf = layout.array(level, field_of(Indicator::linf, saturation));
            REQUIRE(own.grid == linf.grid);
            for (std::int64_t c = 0; c < own.grid.product(); ++c) {
                const Int3 at = own.grid.unlinear(c);
                if (level > 1) {
                    ++compared;
                    wrong += bytes_of(store, own, at) != bytes_of(store, linf, at) ? 1 : 0;
                    continue;
                }
                const std::size_t element = own.codec.element_size;
                std::vector<std::byte> all(own.chunk_bytes());
                std::vector<std::byte> centres(linf.chunk_bytes());
                store.decode(own, at, all);
                store.decode(linf, at, centres);
                const auto slots = static_cast<std::size_t>(own.components) * element;
                for (std::size_t i = 0; i * element < centres.size(); ++i) {
                    ++compared;
                    const auto* const a = all.data() + i * slots + slots - element;
                    wrong += !std::equal(a, a + element, centres.data() + i * element) ? 1 : 0;
                }
            }
        }
    }
    CHECK(compared > 0);
    CHECK(wrong == 0);
}

/// Compares every node of an own indicator with an explicit bisection.
template <class T>
void require_agreement(const Int3& n, const std::function<T(const Int3&)>& f, int chunk) {
    CAPTURE(n.x, n.y, n.z, chunk);
    const TemporaryFolder folder;
    FunctionVolume<T> volume(n, f);
    make_store(volume, folder / "s", with_own(chunk, true, {spread_indicator()}));
    const BisectionOracle oracle(
        n, [&](const Int3& p) { return volume.at(p); }, {1, 1, 1},
        [&](std::span<const Int3> vertices, const Int3&) {
            double low = volume.at(vertices[0]);
            double high = low;
            for (const Int3& v : vertices) {
                low = std::min(low, volume.at(v));
                high = std::max(high, volume.at(v));
            }
            return high - low;
        });
    const StoreReader store(folder / "s");
    ChunkCache cache(store, 1U << 24U);
    NodeSampler sampler(cache);
    std::size_t compared = 0;
    std::size_t wrong = 0;
    for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
        const Field field = own_field("spread", saturation);
        for (const auto& [key, node] : oracle.nodes()) {
            const double stored = sampler.indicator({key[0], key[1], key[2]}, field);
            const double expected = node.of(field);
            ++compared;
            // Rounded up to binary32 on each level.
            const bool good = std::isinf(expected) ? std::isinf(stored)
                                                   : stored >= expected * (1 - 1e-6) &&
                                                         stored <= expected * (1 + 1e-5) + 1e-30;
            if (!good && wrong == 0) {
                UNSCOPED_INFO(name_of(field) << " at " << key[0] << " " << key[1] << " " << key[2]
                                             << ": stored " << stored << ", exact " << expected);
            }
            wrong += good ? 0 : 1;
        }
    }
    CHECK(compared > 0);
    CHECK(wrong == 0);
    const CheckReport report = check(store, {.depth = CheckDepth::deep}, silent_progress());
    CHECK(report.failures == 0);
}

float noisy(const Int3& p) {
    return static_cast<float>(noise(p));
}
std::uint8_t small(const Int3& p) {
    return static_cast<std::uint8_t>(255 * noise(p));
}
std::int32_t wide(const Int3& p) {
    return p.x % 3 == 0   ? std::numeric_limits<std::int32_t>::min()
           : p.y % 2 == 0 ? std::numeric_limits<std::int32_t>::max()
                          : static_cast<std::int32_t>(1e6 * smooth(p));
}
float with_gaps(const Int3& p) {
    return p == Int3{5, 6, 7} || p.x == 12 ? std::numeric_limits<float>::quiet_NaN()
           : p == Int3{2, 2, 3}            ? -std::numeric_limits<float>::infinity()
                                           : noisy(p);
}

template <class Run>
ErrorKind kind_of(const Run& run, std::string* text = nullptr) {
    const Error error = error_of(run);
    if (text != nullptr) {
        *text = error.what();
    }
    return error.kind();
}

}  // namespace

TEST_CASE("an own indicator with the formula of linf is stored as the same bytes") {
    for (const bool exact : {false, true}) {
        require_same_as_linf<std::uint8_t>({33, 33, 33}, small, 8, exact);
        require_same_as_linf<float>({35, 18, 21}, noisy, 8, exact);
        require_same_as_linf<float>({70, 66, 37}, noisy, 16, exact);
        require_same_as_linf<std::int32_t>({17, 14, 9}, wide, 64, exact);
    }
    require_same_as_linf<float>({41, 26, 1}, noisy, 8, true);
    require_same_as_linf<float>({1, 35, 26}, noisy, 8, false);
    require_same_as_linf<std::uint8_t>({1, 77, 1}, small, 8, false);
    const auto plateau = [](const Int3& p) { return static_cast<std::int16_t>(p.x / 9); };
    require_same_as_linf<std::int16_t>({40, 20, 10}, plateau, 8, false);
}

TEST_CASE("an own indicator of the diamond's elements agrees with an explicit bisection") {
    require_agreement<float>({17, 17, 17}, noisy, 8);
    require_agreement<float>({19, 14, 23}, noisy, 8);
    require_agreement<float>({19, 14, 23}, with_gaps, 8);
    require_agreement<std::int32_t>({18, 9, 11}, wide, 8);
    require_agreement<float>({35, 21, 1}, with_gaps, 8);
    require_agreement<float>({23, 1, 18}, noisy, 8);
    require_agreement<float>({1, 1, 45}, noisy, 8);
}

TEST_CASE(
    "own indicators do not depend on threads, memory, ranks or the order in which they are "
    "given") {
    const TemporaryFolder folder;
    const Int3 n{70, 45, 51};
    FunctionVolume<float> volume(n, rough);
    PreprocessOptions options = with_own(16, false, {offset_indicator(), spread_indicator()});
    options.threads = 1;
    make_store(volume, folder / "a", options);
    const std::string expected = read_file(folder / "a");
    options.threads = 7;
    options.memory = std::uint64_t{48} << 20U;
    std::swap(options.own[0], options.own[1]);
    make_store(volume, folder / "b", options);
    const bool same = read_file(folder / "b") == expected;
    CHECK(same);
    on_ranks(
        3, [&](int) { return std::make_unique<FunctionVolume<float>>(n, rough); }, folder / "c",
        options);
    const bool on_three = read_file(folder / "c") == expected;
    CHECK(on_three);
}

TEST_CASE("numbers of own indicators do not depend on the chunk size") {
    const TemporaryFolder folder;
    const Int3 n{37, 29, 33};
    FunctionVolume<float> volume(n, rough);
    make_store(volume, folder / "a", with_own(8, true, {spread_indicator()}));
    make_store(volume, folder / "b", with_own(32, true, {spread_indicator()}));
    const StoreReader a(folder / "a");
    const StoreReader b(folder / "b");
    ChunkCache cache_a(a, 1U << 24U);
    ChunkCache cache_b(b, 1U << 24U);
    NodeSampler sampler_a(cache_a);
    NodeSampler sampler_b(cache_b);
    std::size_t different = 0;
    for (std::int64_t i = 1; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        const Field field = own_field("spread", Saturation::plus);
        different += sampler_a.indicator(p, field) != sampler_b.indicator(p, field) ? 1 : 0;
    }
    CHECK(different == 0);
}

TEST_CASE("an own indicator is also a volume of numbers") {
    const TemporaryFolder folder;
    const Int3 n{37, 18, 21};
    FunctionVolume<float> volume(n, noisy);
    const auto linear = [](const Int3& p) {
        return static_cast<std::uint16_t>(p.x + 40 * p.y + 900 * p.z);
    };
    FunctionVolume<std::uint16_t> numbers(n, linear);
    const auto same = [&](const RefinementNode& x) { return numbers.at(x.node); };
    make_store(volume, folder / "f", with_own(8, false, {own_indicator("n", same)}));
    make_store(volume, folder / "v",
               with_own(8, false, {own_indicator("n", numbers, folder.path())}));
    const bool equal = read_file(folder / "f") == read_file(folder / "v");
    CHECK(equal);
    CHECK(folder.names().size() == 2);
    // In memory: nothing is copied.
    const std::vector<double> dense(static_cast<std::size_t>(n.product()), 2.5);
    MemoryVolume mapped(dense.data(), n);
    make_store(volume, folder / "m",
               with_own(8, true, {own_indicator("n", mapped, "/no/such/folder")}));
    const StoreReader store(folder / "m");
    CHECK(check(store, {}, silent_progress()).failures == 0);
    CHECK(store.totals(store.layout().array(3, own_field("n", Saturation::bar))).max == 2.5);
    CHECK(store.totals(store.layout().array(1, own_field("n", Saturation::plus))).max == 7.5);
    FunctionVolume<float> other({37, 18, 22}, noisy);
    CHECK(kind_of([&] {
              make_store(volume, folder / "o",
                         with_own(8, false, {own_indicator("n", other, folder.path())}));
          }) == ErrorKind::invalid_argument);
}

TEST_CASE("a function of the caller sees the diamond of each node") {
    const TemporaryFolder folder;
    const Int3 n{19, 12, 15};
    FunctionVolume<float> volume(n, noisy);
    volume.spacing_ = {1, 2, 0.5};
    std::atomic<std::size_t> faults = 0;
    std::atomic<std::size_t> calls = 0;
    const auto look = [&](const RefinementNode& x) {
        ++calls;
        const Lattice lattice(n);
        const NodeInfo info = describe_node(x.node, lattice.top());
        bool good = info.level() == x.level && static_cast<int>(info.kind) == x.odd_axes &&
                    x.ends == std::array{info.end0, info.end1} && x.value == volume.at(x.node) &&
                    x.end_values[0] == volume.at(x.ends[0]) &&
                    x.end_values[1] == volume.at(x.ends[1]) && !x.elements.empty() &&
                    x.elements.size() <= 8 && x.volume->nodes == n &&
                    x.volume->spacing == volume.spacing_;
        for (const RefinedElement& t : x.elements) {
            good = good && t.count == 4 && t.vertices[0] == x.ends[0] && t.vertices[1] == x.ends[1];
            for (std::size_t v = 0; v < 4; ++v) {
                good = good && t.values[v] == volume.at(t.vertices[v]);
            }
        }
        faults += good ? 0 : 1;
        return 0.0;
    };
    make_store(volume, folder / "s", with_own(8, false, {own_indicator("look", look)}));
    CHECK(calls > static_cast<std::size_t>(n.product()));
    CHECK(faults == 0);
}

TEST_CASE("a number below 0 or NaN of an own indicator is an error that names the node") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({19, 12, 15}, noisy);
    const Int3 bad{4, 6, 8};
    for (const double number : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
        std::string text;
        const auto eta = [&](const RefinementNode& x) { return x.node == bad ? number : 1.0; };
        const ErrorKind kind = kind_of(
            [&] {
                make_store(volume, folder / "s", with_own(8, false, {own_indicator("bad", eta)}));
            },
            &text);
        CHECK(kind == ErrorKind::invalid_argument);
        CHECK(text.find("4 6 8") != std::string::npos);
        CHECK(folder.names().empty());
    }
    // What the function itself throws reaches the caller.
    const auto thrower = [](const RefinementNode&) -> double { throw std::runtime_error("mine"); };
    CHECK_THROWS_AS(
        make_store(volume, folder / "s", with_own(8, false, {own_indicator("t", thrower)})),
        std::runtime_error);
    // Infinity is a number: such a node is always refined.
    const auto infinite = [](const RefinementNode&) {
        return std::numeric_limits<double>::infinity();
    };
    make_store(volume, folder / "s", with_own(8, false, {own_indicator("all", infinite)}));
    CHECK(check(StoreReader(folder / "s"), {}, silent_progress()).failures == 0);
}

TEST_CASE("names of own indicators are checked") {
    for (const char* const name :
         {"", "1a", "a b", "own:a", "a,b", "-a", "a/b", "abcdefghijklmnopqrstuvwxyzabcdefg"}) {
        CAPTURE(name);
        CHECK(kind_of([&] { own_field(name, Saturation::bar); }) == ErrorKind::invalid_argument);
        CHECK(!field_from_name("own:" + std::string(name) + "_bar"));
    }
    const Field bar = own_field("a_bar-2", Saturation::bar);
    CHECK(name_of(bar) == "own:a_bar-2_bar");
    CHECK(field_from_name("own:a_bar-2_bar") == bar);
    CHECK(field_from_name("own:a_bar-2_plus") == own_field("a_bar-2", Saturation::plus));
    CHECK(!field_from_name("own:a_bar-2"));
    CHECK(!is_bound(bar));
    const TemporaryFolder folder;
    FunctionVolume<float> volume({9, 9, 9}, noisy);
    const auto refused = [&](const PreprocessOptions& options) {
        return kind_of([&] { make_store(volume, folder / "s", options); }) ==
               ErrorKind::invalid_argument;
    };
    CHECK(refused(with_own(8, false, {offset_indicator(), offset_indicator()})));
    CHECK(refused(with_own(8, false, {OwnIndicator{"empty", {}, {}}})));
    CHECK(refused(
        with_own(8, false, std::vector<OwnIndicator>(kMaxOwnIndicators + 1, offset_indicator()))));
    PreprocessOptions without_function = with_chunk(8);
    without_function.fields = {bar};
    CHECK(refused(without_function));
    CHECK(folder.names().empty());
}

TEST_CASE(
    "a run with own indicators is resumed only with the same ones, and needs their identity") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({40, 40, 60}, rough);
    make_store(volume, folder / "whole", with_own(8, false, {offset_indicator()}));
    PreprocessOptions options = with_own(8, false, {offset_indicator()});
    options.resume = true;
    options.threads = 1;
    class StopsAt : public Progress {
      public:
        [[nodiscard]] bool cancelled() const override { return --left_ < 0; }
        mutable int left_ = 30;
    } progress;
    const auto run = [&](Progress& p) { return preprocess(volume, folder / "s", options, p); };
    REQUIRE(kind_of([&] { run(progress); }) == ErrorKind::cancelled);
    options.own[0].identity = "offset 2";
    CHECK(kind_of([&] { run(silent_progress()); }) == ErrorKind::invalid_argument);
    options.own[0].identity = "";
    CHECK(kind_of([&] { run(silent_progress()); }) == ErrorKind::invalid_argument);
    options.own[0].identity = "offset 1";
    CHECK(run(silent_progress()).resumed_chunks > 0);
    const bool same = read_file(folder / "s") == read_file(folder / "whole");
    CHECK(same);
}
