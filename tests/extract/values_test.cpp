// Values of boxes, indicators at nodes and values between nodes are those of a direct look at the
// volume.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include <isonest/error.h>
#include <isonest/values.h>

#include "query/values/node_sampler.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "store/lattice/simplex.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class F>
ErrorKind kind_of(const F& f) {
    try {
        f();
    } catch (const Error& error) {
        return error.kind();
    }
    FAIL("nothing was thrown");
    return ErrorKind::io;
}

/// Random boxes of a level, and the whole level.
std::vector<NodeBox> some_boxes(const Int3& nodes, std::mt19937& random) {
    std::vector<NodeBox> boxes{{{}, nodes}};
    for (int i = 0; i < 4; ++i) {
        NodeBox box;
        for (int axis = 0; axis < 3; ++axis) {
            box.lo[axis] = static_cast<std::int64_t>(random() % nodes[axis]);
            box.size[axis] = 1 + static_cast<std::int64_t>(random() % (nodes[axis] - box.lo[axis]));
        }
        boxes.push_back(box);
    }
    return boxes;
}

template <class T>
T extreme(const Int3& p) {
    using Limits = std::numeric_limits<T>;
    const std::array<T, 6> rare{Limits::lowest(),
                                Limits::max(),
                                Limits::has_infinity ? Limits::infinity() : T{1},
                                Limits::has_infinity ? -Limits::infinity() : T{2},
                                Limits::has_quiet_NaN ? Limits::quiet_NaN() : T{3},
                                T{0}};
    const auto k = static_cast<std::size_t>(noise(p, 3) * 20);
    return k < rare.size() ? rare[k] : static_cast<T>(100 * noise(p));
}

template <class T, class Read>
void require_values(const Store& store, const std::function<T(const Int3&)>& f,
                    const ReadOptions& options, std::mt19937& random) {
    for (int level = 0; level < store.levels(); ++level) {
        const std::int64_t stride = std::int64_t{1} << level;
        const Int3 nodes = nodes_of_level(store, level);
        REQUIRE(nodes == ceil_div(store.nodes(), Int3{stride, stride, stride}));
        for (const NodeBox& box : some_boxes(nodes, random)) {
            std::vector<Read> got(static_cast<std::size_t>(box.size.product()));
            read_values(store, level, box, std::span(got), options);
            std::size_t wrong = 0;
            for (std::int64_t i = 0; i < box.size.product(); ++i) {
                const auto v = static_cast<Read>(f((box.lo + box.size.unlinear(i)) * stride));
                const Read g = got[static_cast<std::size_t>(i)];
                wrong += g == v || (g != g && v != v) ? 0 : 1;
            }
            REQUIRE(wrong == 0);
        }
    }
}

template <class T>
void require_values_of_type(const Int3& n, int chunk) {
    CAPTURE(n.x, n.y, n.z, chunk, name_of(value_type_of<T>));
    FunctionVolume<T> volume(n, extreme<T>);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(chunk));
    const Store store(folder / "s");
    std::mt19937 random(1);
    require_values<T, T>(store, extreme<T>, {.threads = 1}, random);
    require_values<T, double>(store, extreme<T>, {.memory = 12U << 20U, .threads = 3}, random);
    std::vector<std::int64_t> whole(static_cast<std::size_t>(n.product()));
    const auto read_whole = [&] { read_values(store, 0, {{}, n}, std::span(whole)); };
    if constexpr (std::is_integral_v<T>) {
        require_values<T, std::int64_t>(store, extreme<T>, {}, random);
    } else {
        CHECK(kind_of(read_whole) == ErrorKind::invalid_argument);
    }
    using Other = std::conditional_t<std::is_same_v<T, float>, std::uint8_t, float>;
    std::vector<Other> other(whole.size());
    CHECK(kind_of([&] {
              read_values(store, 0, {{}, n}, std::span(other));
          }) == ErrorKind::invalid_argument);
}

}  // namespace

TEST_CASE("the values of any box and level are the volume's") {
    for (const Int3& n : {Int3{18, 9, 25}, Int3{37, 1, 20}, Int3{1, 1, 1}}) {
        require_values_of_type<std::uint8_t>(n, 8);
        require_values_of_type<std::int32_t>(n, 16);
        require_values_of_type<float>(n, 8);
        require_values_of_type<double>(n, 16);
    }
    require_values_of_type<std::int8_t>({9, 17, 6}, 8);
    require_values_of_type<std::uint16_t>({9, 17, 6}, 8);
    require_values_of_type<std::int16_t>({9, 17, 6}, 8);
    require_values_of_type<std::uint32_t>({9, 17, 6}, 8);
}

TEST_CASE("a box outside the level, too little room, memory and a missing field are errors") {
    FunctionVolume<float> volume({20, 10, 12},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    std::vector<float> room(8);
    const auto read = [&](int level, const NodeBox& box, const ReadOptions& options = {}) {
        return kind_of([&] { read_values(store, level, box, std::span(room), options); });
    };
    constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max();
    CHECK(read(0, {{19, 0, 0}, {2, 2, 2}}) == ErrorKind::invalid_argument);
    CHECK(read(0, {{-1, 0, 0}, {2, 2, 2}}) == ErrorKind::invalid_argument);
    CHECK(read(0, {{kMax, 0, 0}, {2, 2, 2}}) == ErrorKind::invalid_argument);
    CHECK(read(0, {{0, 0, 0}, {kMax, 2, 2}}) == ErrorKind::invalid_argument);
    CHECK(read(1, {{9, 0, 0}, {2, 2, 2}}) == ErrorKind::invalid_argument);
    CHECK(read(0, {{0, 0, 0}, {2, 2, 3}}) == ErrorKind::invalid_argument);
    CHECK(read(store.levels(), {{0, 0, 0}, {2, 2, 2}}) == ErrorKind::not_found);
    CHECK(read(-1, {{0, 0, 0}, {2, 2, 2}}) == ErrorKind::not_found);
    CHECK(read(0, {{0, 0, 0}, {2, 2, 2}}, {.memory = 1000}) == ErrorKind::limit);
    std::vector<float> none;
    CHECK_NOTHROW(read_values(store, 0, {{3, 3, 3}, {0, 2, 2}}, std::span(none)));
    std::vector<double> numbers(8);
    const auto indicator = [&](Field field) {
        return kind_of([&] { read_indicator(store, field, 0, {{}, {2, 2, 2}}, numbers); });
    };
    CHECK(indicator(Field::normal_plus) == ErrorKind::not_found);
    CHECK(indicator(Field::values) == ErrorKind::invalid_argument);
    CHECK(indicator(Field::hex_linf) == ErrorKind::invalid_argument);
    const std::vector<Double3> points(7);
    CHECK(kind_of([&] { sample(store, points, numbers); }) == ErrorKind::invalid_argument);
}

TEST_CASE("the indicator at the nodes of any box and level is the one that a query reads there") {
    for (const Int3& n : {Int3{18, 9, 25}, Int3{37, 1, 20}, Int3{17, 33, 17}}) {
        CAPTURE(n.x, n.y, n.z);
        FunctionVolume<float> volume(n, [](const Int3& p) {
            return static_cast<float>(noise(p, 5) < 0.01 ? kNaN : smooth(p) + 0.2 * noise(p));
        });
        const TemporaryFolder folder;
        PreprocessOptions made = with_chunk(8);
        made.fields = {Field::deviation_bar, Field::linf_plus, Field::grad_linf_bar};
        make_store(volume, folder / "s", made);
        const Store store(folder / "s");
        std::mt19937 random(2);
        for (const Field field : made.fields) {
            for (int level = 0; level < store.levels(); ++level) {
                for (const NodeBox& box : some_boxes(nodes_of_level(store, level), random)) {
                    std::vector<double> got(static_cast<std::size_t>(box.size.product()));
                    read_indicator(store, field, level, box, got,
                                   {.threads = level % 2 == 0 ? 1 : 3});
                    ChunkCache cache(store.reader(), 8U << 20U, NodeSampler::kSides);
                    NodeSampler sampler(cache);
                    std::size_t wrong = 0;
                    for (std::int64_t i = 0; i < box.size.product(); ++i) {
                        const Int3 p = (box.lo + box.size.unlinear(i)) * (std::int64_t{1} << level);
                        wrong +=
                            got[static_cast<std::size_t>(i)] == sampler.indicator(p, field) ? 0 : 1;
                    }
                    CAPTURE(name_of(field), level);
                    REQUIRE(wrong == 0);
                }
            }
        }
    }
}

namespace {

/// A volume anywhere in the world.
template <class T>
class Placed : public FunctionVolume<T> {
  public:
    Placed(const Int3& nodes, const std::function<T(const Int3&)>& f, const Directions& direction)
        : FunctionVolume<T>(nodes, f), direction_(direction) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription d = FunctionVolume<T>::describe();
        d.spacing = {0.5, 1.25, 2};
        d.origin = {-3, 40, 7.5};
        d.direction = direction_;
        return d;
    }

  private:
    Directions direction_;
};

/// By barycentric coordinates in the tetrahedron that contains the point: the ratios of volumes.
template <class At>
double in_tetrahedra(const At& at, const Int3& cube, std::int64_t edge, const Double3& x) {
    const auto volume_of = [](const std::array<Double3, 4>& v) {
        const auto d = [&](std::size_t i, std::size_t a) { return v[i][a] - v[0][a]; };
        return d(1, 0) * (d(2, 1) * d(3, 2) - d(2, 2) * d(3, 1)) -
               d(1, 1) * (d(2, 0) * d(3, 2) - d(2, 2) * d(3, 0)) +
               d(1, 2) * (d(2, 0) * d(3, 1) - d(2, 1) * d(3, 0));
    };
    for (int order = 0; order < 6; ++order) {
        const Tetrahedron t = kuhn_tetrahedron(cube, edge, order);
        std::array<Double3, 4> v{};
        for (std::size_t i = 0; i < 4; ++i) {
            v[i] = {double(t.v[i].x), double(t.v[i].y), double(t.v[i].z)};
        }
        double sum = 0;
        double least = 1;
        for (std::size_t i = 0; i < 4; ++i) {
            std::array<Double3, 4> with = v;
            with[i] = x;
            const double weight = volume_of(with) / volume_of(v);
            least = std::min(least, weight);
            sum += weight != 0 ? weight * at(t.v[i]) : 0;
        }
        if (least >= -1e-9) {
            return sum;
        }
    }
    return kNaN;
}

template <class At>
double in_cube(const At& at, const Int3& cube, std::int64_t edge, const Double3& x) {
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
        const Int3 o{corner & 1, corner >> 1 & 1, corner >> 2 & 1};
        double weight = 1;
        for (int a = 0; a < 3; ++a) {
            const double f = x[a] / double(edge) - double(cube[a]);
            weight *= o[a] != 0 ? f : 1 - f;
        }
        sum += weight != 0 ? weight * at((cube + o) * edge) : 0;
    }
    return sum;
}

}  // namespace

TEST_CASE("values between nodes are interpolated as by barycentric and trilinear weights") {
    const double c = std::cos(0.3);
    const double s = std::sin(0.3);
    const Directions turned{{{c, s, 0}, {-s, c, 0}, {0, 0, 1}}};
    const Directions sheared{{{1, 0, 0}, {s, c, 0}, {0, 0, 1}}};
    const std::function<float(const Int3&)> f = [](const Int3& p) {
        return static_cast<float>(noise(p, 11) < 0.01 ? kNaN : 10 * noise(p) + smooth(p));
    };
    for (const Directions& direction : {kAlongWorld, turned, sheared}) {
        for (const Int3& n : {Int3{18, 9, 14}, Int3{17, 17, 9}}) {
            CAPTURE(n.x, direction[1][0], direction[0][1]);
            Placed<float> volume(n, f, direction);
            const VolumeDescription d = volume.describe();
            const TemporaryFolder folder;
            make_store(volume, folder / "s", with_chunk(8));
            const Store store(folder / "s");
            std::mt19937 random(3);
            std::uniform_real_distribution<double> unit(-0.05, 1.05);
            std::vector<Double3> steps;
            for (int i = 0; i < 3000; ++i) {
                steps.push_back({unit(random) * double(n.x - 1), unit(random) * double(n.y - 1),
                                 unit(random) * double(n.z - 1)});
                if (i % 5 == 0) {  // nodes, faces
                    for (double& x : steps.back()) {
                        x = i % 10 == 0 || random() % 2 == 0 ? std::round(x) : x;
                    }
                }
            }
            std::vector<Double3> points;
            for (const Double3& p : steps) {
                Double3 world = d.origin;
                for (std::size_t a = 0; a < 3; ++a) {
                    for (std::size_t w = 0; w < 3; ++w) {
                        world[w] += d.direction[a][w] * d.spacing[a] * p[a];
                    }
                }
                points.push_back(world);
            }
            points.push_back({kNaN, 0, 0});
            points.push_back({1e300, -1e300, 0});
            for (int level = 0; level < store.levels(); ++level) {
                const std::int64_t edge = std::int64_t{1} << level;
                const auto at = [&](const Int3& p) { return volume.at(p); };
                for (const Cells cells : {Cells::tetrahedra, Cells::hexahedra}) {
                    std::vector<double> got(points.size(), -1);
                    sample(store, points, got, {.level = level, .cells = cells, .threads = 1});
                    std::vector<double> again(points.size(), -1);
                    sample(store, points, again,
                           {.level = level, .cells = cells, .memory = 13U << 20U, .threads = 3});
                    std::size_t inside = 0;
                    std::size_t wrong = 0;
                    for (std::size_t i = 0; i < points.size(); ++i) {
                        wrong += got[i] == again[i] || std::isnan(got[i]) ? 0 : 1;
                        wrong += std::isnan(got[i]) == std::isnan(again[i]) ? 0 : 1;
                        bool is_inside = i < steps.size();
                        Int3 cube;
                        for (int a = 0; is_inside && a < 3; ++a) {
                            is_inside = steps[i][a] >= 0 && steps[i][a] <= double(n[a] - 1);
                            cube[a] = std::min(static_cast<std::int64_t>(steps[i][a]) / edge,
                                               ceil_div(n[a] - 1, edge) - 1);
                        }
                        if (!is_inside) {
                            wrong += std::isnan(got[i]) ? 0 : 1;
                            continue;
                        }
                        const double v = cells == Cells::tetrahedra
                                             ? in_tetrahedra(at, cube, edge, steps[i])
                                             : in_cube(at, cube, edge, steps[i]);
                        inside += std::isnan(v) ? 0 : 1;
                        // A weight that is 0 but for rounding decides whether a missing value
                        // counts.
                        const bool near = std::isnan(v) != std::isnan(got[i]) && i % 5 == 0;
                        wrong += near || std::fabs(v - got[i]) < 1e-6 ||
                                         (std::isnan(v) && std::isnan(got[i]))
                                     ? 0
                                     : 1;
                    }
                    CAPTURE(level, static_cast<int>(cells));
                    REQUIRE(inside > 1000);
                    REQUIRE(wrong == 0);
                }
            }
            // At a node that is there, neighbours do not count.
            const Int3 p{n.x - 1, 3, 4};
            REQUIRE(std::isfinite(f(p)));
            Double3 world = d.origin;
            for (std::size_t a = 0; a < 3; ++a) {
                for (std::size_t w = 0; w < 3; ++w) {
                    world[w] += d.direction[a][w] * d.spacing[a] * double(p[static_cast<int>(a)]);
                }
            }
            std::vector<double> one(1);
            sample(store, std::vector{world}, one);
            CHECK(one[0] == static_cast<double>(f(p)));
        }
    }
}

TEST_CASE("in a plane values between nodes are interpolated in its triangles and squares") {
    const std::function<double(const Int3&)> f = [](const Int3& p) { return noise(p); };
    Placed<double> volume({12, 9, 1}, f, kAlongWorld);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    // The middle of the square (1, 1) to (2, 2): its diagonal starts at the even corner (2, 2).
    const std::vector<Double3> points{{-3 + 1.5 * 0.5, 40 + 1.5 * 1.25, 7.5},
                                      {-3 + 1.5 * 0.5, 40 + 1.5 * 1.25, 7.6}};
    std::vector<double> values(2);
    sample(store, points, values);
    CHECK(std::fabs(values[0] - (f({1, 1, 0}) + f({2, 2, 0})) / 2) < 1e-9);
    CHECK(std::isnan(values[1]));
    sample(store, points, values, {.cells = Cells::hexahedra});
    CHECK(std::fabs(values[0] - (f({1, 1, 0}) + f({2, 2, 0}) + f({1, 2, 0}) + f({2, 1, 0})) / 4) <
          1e-9);
}
