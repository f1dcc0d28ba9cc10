#include "query/march/vertex_attributes.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "store/base/vectors.h"
#include "store/container/codec.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

FinestCrossing::Edge FinestCrossing::between(const Int3& a, double a_value, const Int3& b,
                                             double b_value) {
    const bool in_order = a.z != b.z ? a.z < b.z : a.y != b.y ? a.y < b.y : a.x < b.x;
    return in_order ? Edge{a, b, a_value, b_value} : Edge{b, a, b_value, a_value};
}

FinestCrossing::Edge FinestCrossing::finest(Edge edge) {
    for (;;) {
        const Int3 twice = edge.from + edge.to;
        if (((twice.x | twice.y | twice.z) & 1) != 0) {
            return edge;
        }
        const Int3 middle{twice.x / 2, twice.y / 2, twice.z / 2};
        const double value = nodes_.value(middle, level_of_node(middle));
        if (!std::isfinite(value)) {
            return edge;
        }
        if ((edge.from_value < iso_) != (value < iso_)) {
            edge.to = middle;
            edge.to_value = value;
        } else {
            edge.from = middle;
            edge.from_value = value;
        }
    }
}

namespace {

/// a + t (b - a), with its maximum rounding error.
struct Interpolated {
    double value;
    double rounding;
};

/// The rounding error of each step is itself a double, and is computed exactly. Source: T. J.
/// Dekker, "A floating-point technique for extending the available precision" (1971); D. E. Knuth,
/// TAOCP 2, 4.2.2.
Interpolated interpolate(double a, double b, double t) {
    if (t == 0) {
        return {a, 0};
    }
    const auto lost = [](double x, double y, double sum) {
        const double of_y = sum - x;
        return std::fabs((x - (sum - of_y)) + (y - of_y));
    };
    const double d = b - a;
    if (!std::isfinite(d)) {
        return {(1 - t) * a + t * b, std::max(std::fabs(a), std::fabs(b)) * 0x1p-50};
    }
    const double step = t * d;
    const double value = a + step;
    constexpr double kUp = 1 + 0x1p-50;
    return {value, (std::fabs(t) * lost(b, -a, d) + std::fabs(std::fma(t, d, -step)) +
                    lost(a, step, value)) *
                       kUp};
}

double float_of(AttributeWord word) {
    return static_cast<double>(std::bit_cast<float>(word));
}

AttributeWord word_of(double number) {
    return std::bit_cast<AttributeWord>(static_cast<float>(number));
}

void put_normal(const Double3& n, VertexAttributes& words) {
    const std::array<float, 3> unit = unit_normal(n);
    std::transform(unit.begin(), unit.end(), words.begin(),
                   [](float x) { return std::bit_cast<AttributeWord>(x); });
}

}  // namespace

bool held_by_float32(const StoreReader& store) {
    constexpr double kLargestInteger = 1 << 24;
    const ValueType type = store.layout().header().type;
    if (type != ValueType::i32 && type != ValueType::u32) {
        return type != ValueType::f64;
    }
    return store.min_value() >= -kLargestInteger && store.max_value() <= kLargestInteger;
}

double AttributeChoice::value_of(std::span<const AttributeWord> words) const {
    if (!wide_value) {
        return float_of(words[value_at()]);
    }
    double number = 0;
    std::memcpy(&number, words.data() + value_at(), sizeof(number));
    return number;
}

double AttributeChoice::put_value(double number, std::span<AttributeWord> words) const {
    if (wide_value) {
        std::memcpy(words.data() + value_at(), &number, sizeof(number));
    } else {
        words[value_at()] = word_of(number);
    }
    return value_of(words);
}

std::vector<AttributeChoice::Array> AttributeChoice::arrays() const {
    std::vector<Array> all;
    std::size_t first = 0;
    const auto add = [&](bool chosen, const char* name, std::size_t components, bool wide) {
        if (chosen) {
            all.push_back({name, first, components, wide});
            first += all.back().bytes() / sizeof(AttributeWord);
        }
    };
    add(normal, "normal", 3, false);
    add(value, "value", 1, wide_value);
    add(error.has_value(), "error", 1, false);
    return all;
}

AttributeSampler::AttributeSampler(const AttributeChoice& choice, ChunkCache& own,
                                   ChunkCache* values)
    : choice_(choice),
      width_(choice.width()),
      own_(own),
      values_(values != nullptr ? *values : own) {}

void AttributeSampler::enter(int level, const Int3& node) {
    own_.enter(level, node);
    values_.enter(level, node);
    home_level_ = level;
}

void AttributeSampler::leave() {
    own_.leave();
    values_.leave();
    home_level_.reset();
}

double AttributeSampler::value(const Int3& p, int level) {
    if (of_node_) {
        return of_node_(p);
    }
    const std::int64_t stride = std::int64_t{1} << home_level_.value_or(0);
    const bool at_home = home_level_ && ((p.x | p.y | p.z) & (stride - 1)) == 0;
    return values_.value(p, at_home ? *home_level_ : level);
}

VertexAttributes AttributeSampler::edge(const Int3& a, const Int3& b, double t) {
    return sample(a, b, t, true);
}

VertexAttributes AttributeSampler::sample(const Int3& a, const Int3& b, double t, bool with_error) {
    VertexAttributes out{};
    if (width_ == 0) {
        return out;
    }
    const Int3 d = b - a;
    const auto reach = static_cast<std::uint64_t>(
        std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z), std::int64_t{1}}));
    const int level = std::countr_zero(reach);
    if (choice_.normal && choice_.plane_normal) {
        put_normal(*choice_.plane_normal, out);
    } else if (choice_.normal) {
        const Double3 ga = own_.gradient(a, level);
        const Double3 gb = own_.gradient(b, level);
        Double3 n{};
        for (std::size_t i = 0; i < 3; ++i) {
            n[i] = -(ga[i] + t * (gb[i] - ga[i]));
        }
        if (choice_.graph_scale) {
            n = {n[0] * *choice_.graph_scale, n[1] * *choice_.graph_scale, 1};
        }
        put_normal(n, out);
    }
    if (choice_.value) {
        const double va = value(a, level);
        const double vb = value(b, level);
        const auto [number, rounding] = interpolate(va, vb, t);
        const double put = choice_.put_value(number, out);
        value_rounding_.add({rounding + std::fabs(put - number), 0});
    }
    if (choice_.error && with_error) {
        const Int3 sum = a + b;
        const bool has_midpoint = ((sum.x | sum.y | sum.z) & 1) == 0;
        out[width_ - 1] = std::bit_cast<AttributeWord>(
            has_midpoint ? round_up_to_float(
                               own_.indicator({sum.x / 2, sum.y / 2, sum.z / 2}, *choice_.error))
                         : 0.0F);
    }
    return out;
}

VertexAttributes AttributeSampler::node(const Int3& p) {
    return sample(p, p, 0, false);  // no error: the function is exact at its nodes
}

VertexAttributes AttributeSampler::mix(const VertexAttributes& a, const VertexAttributes& b,
                                       double t) {
    VertexAttributes out{};
    const auto put_mixed = [&](std::size_t i) {
        out[i] = word_of(float_of(a[i]) + t * (float_of(b[i]) - float_of(a[i])));
    };
    for (std::size_t i = 0; i < choice_.value_at(); ++i) {
        put_mixed(i);
    }
    if (choice_.error) {
        put_mixed(width_ - 1);
    }
    if (choice_.value) {
        const auto [number, rounding] = interpolate(choice_.value_of(a), choice_.value_of(b), t);
        const double put = choice_.put_value(number, out);
        value_rounding_.add({0, rounding + std::fabs(put - number)});
    }
    return out;
}

VertexAttributes AttributeSampler::mean(const VertexAttributes& a, const VertexAttributes& b,
                                        const VertexAttributes& c) {
    VertexAttributes out{};
    const auto put_mean = [&](std::size_t i) {
        out[i] = std::bit_cast<AttributeWord>(
            (std::bit_cast<float>(a[i]) + std::bit_cast<float>(b[i]) + std::bit_cast<float>(c[i])) /
            3);
    };
    for (std::size_t i = 0; i < choice_.value_at(); ++i) {
        put_mean(i);
    }
    if (choice_.error) {
        put_mean(width_ - 1);
    }
    if (choice_.value) {
        if (!choice_.wide_value) {
            put_mean(choice_.value_at());
        }
        const double first = choice_.value_of(a);
        const double second = choice_.value_of(b);
        const double third = choice_.value_of(c);
        // In thirds, so that a sum of large numbers stays finite.
        const double number = first / 3 + second / 3 + third / 3;
        const double put =
            choice_.wide_value ? choice_.put_value(number, out) : choice_.value_of(out);
        const double size = std::max({std::fabs(first), std::fabs(second), std::fabs(third)});
        value_rounding_.add({0, std::fabs(put - number) + size * 0x1p-50});
    }
    return out;
}

VertexAttributes AttributeSampler::with_unit_normal(const VertexAttributes& a) const {
    VertexAttributes out = a;
    if (choice_.normal) {
        put_normal({float_of(a[0]), float_of(a[1]), float_of(a[2])}, out);
    }
    return out;
}

}  // namespace isonest::detail
