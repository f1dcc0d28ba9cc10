#include "query/vertex_attributes.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace isonest {

std::vector<AttributeChoice::Array> AttributeChoice::arrays() const {
    std::vector<Array> all;
    std::size_t first = 0;
    const auto add = [&](bool chosen, const char* name, std::size_t components) {
        if (chosen) {
            all.push_back({name, first, components});
            first += components;
        }
    };
    add(normal, "normal", 3);
    add(value, "value", 1);
    add(error.has_value(), "error", 1);
    return all;
}

AttributeSampler::AttributeSampler(const AttributeChoice& choice, ChunkCache& own,
                                   ChunkCache* values)
    : choice_(choice),
      width_(choice.width()),
      own_(own),
      values_(values != nullptr ? *values : own),
      spacing_(own.source().layout().header().spacing) {}

void AttributeSampler::enter(int level, const Int3& node) {
    own_.enter(level, node);
    values_.enter(level, node);
}

void AttributeSampler::leave() {
    own_.leave();
    values_.leave();
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
    std::size_t at = 0;
    if (choice_.normal) {
        const Double3 ga = own_.gradient(a, level);
        const Double3 gb = own_.gradient(b, level);
        Double3 n{};
        for (std::size_t i = 0; i < 3; ++i) {
            n[i] = -(ga[i] + t * (gb[i] - ga[i]));
        }
        if (choice_.graph_scale) {
            n = {n[0] * *choice_.graph_scale, n[1] * *choice_.graph_scale, 1};
        }
        const double size = std::hypot(n[0], n[1], n[2]);
        for (std::size_t i = 0; i < 3; ++i) {
            out[at++] = size > 0 && std::isfinite(size) ? static_cast<float>(n[i] / size) : 0.0F;
        }
    }
    if (choice_.value) {
        const double va = values_.value(a, level);
        const double vb = values_.value(b, level);
        out[at++] = static_cast<float>(va + t * (vb - va));
    }
    if (choice_.error && with_error) {
        const Int3 sum = a + b;
        const bool has_midpoint = ((sum.x | sum.y | sum.z) & 1) == 0;
        out[at++] = has_midpoint ? static_cast<float>(own_.indicator(
                                       {sum.x / 2, sum.y / 2, sum.z / 2}, *choice_.error))
                                 : 0.0F;
    }
    return out;
}

VertexAttributes AttributeSampler::node(const Int3& p) {
    return sample(p, p, 0, false);  // no error: the function itself holds in its nodes
}

VertexAttributes mix(const VertexAttributes& a, const VertexAttributes& b, double t) {
    VertexAttributes out{};
    for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = static_cast<float>(static_cast<double>(a[i]) +
                                    t * (static_cast<double>(b[i]) - static_cast<double>(a[i])));
    }
    return out;
}

}  // namespace isonest
