#include "query/finite_elements/gaussian.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "store/base/simd.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kColumns = 32;  ///< lines that are convolved side by side

/// Weights of the distances 0, 1, ..; their sum over both sides is 1.
std::vector<float> weights_of(double sigma, std::int64_t nodes) {
    constexpr double kCut = 4;
    const auto radius =
        std::min<std::int64_t>(static_cast<std::int64_t>(std::ceil(kCut * sigma)), nodes - 1);
    std::vector<double> w(static_cast<std::size_t>(radius) + 1);
    double sum = 0;
    for (std::size_t i = 0; i < w.size(); ++i) {
        const double t = static_cast<double>(i) / sigma;
        w[i] = std::exp(-0.5 * t * t);
        sum += i == 0 ? w[i] : 2 * w[i];
    }
    std::vector<float> out;
    out.reserve(w.size());
    for (const double weight : w) {
        out.push_back(static_cast<float>(weight / sum));
    }
    return out;
}

/// The lines along an axis: `count` nodes `stride` apart.
struct Lines {
    std::int64_t count;
    std::int64_t stride;
};

/// out += weight (low + high).
ISONEST_SIMD
void add_pair(float* out, const float* low, const float* high, float weight, std::int64_t count) {
    for (std::int64_t i = 0; i < count; ++i) {
        out[i] += weight * (low[i] + high[i]);
    }
}

/// Convolves `columns` neighbouring lines from `first` on. `buffer`: of them all, with borders.
void convolve(float* first, const Lines& lines, std::int64_t columns,
              const std::vector<float>& weights, std::vector<float>& buffer) {
    const auto radius = static_cast<std::int64_t>(weights.size()) - 1;
    buffer.resize(static_cast<std::size_t>((lines.count + 2 * radius) * columns));
    for (std::int64_t i = -radius; i < lines.count + radius; ++i) {
        const std::int64_t from = i < 0 ? -i : i >= lines.count ? 2 * (lines.count - 1) - i : i;
        std::copy_n(first + from * lines.stride, columns, buffer.data() + (i + radius) * columns);
    }
    if (columns == 1 && lines.stride == 1) {
        const float* const middle = buffer.data() + radius;
        for (std::int64_t i = 0; i < lines.count; ++i) {
            first[i] = weights[0] * middle[i];
        }
        for (std::int64_t k = 1; k <= radius; ++k) {
            add_pair(first, middle - k, middle + k, weights[static_cast<std::size_t>(k)],
                     lines.count);
        }
        return;
    }
    for (std::int64_t i = 0; i < lines.count; ++i) {
        float* const out = first + i * lines.stride;
        const float* const middle = buffer.data() + (i + radius) * columns;
        for (std::int64_t c = 0; c < columns; ++c) {
            out[c] = weights[0] * middle[c];
        }
        for (std::int64_t k = 1; k <= radius; ++k) {
            add_pair(out, middle - k * columns, middle + k * columns,
                     weights[static_cast<std::size_t>(k)], columns);
        }
    }
}

}  // namespace

void smooth_gaussian(std::span<float> values, const Int3& nodes, const Double3& spacing,
                     double sigma) {
    tbb::enumerable_thread_specific<std::vector<float>> buffers;
    for (int axis = 0; axis < 3; ++axis) {
        const double in_nodes = sigma / spacing[static_cast<std::size_t>(axis)];
        if (nodes[axis] == 1 || !(in_nodes > 0)) {
            continue;
        }
        const std::vector<float> weights = weights_of(in_nodes, nodes[axis]);
        const std::int64_t stride = axis == 0 ? 1 : axis == 1 ? nodes.x : nodes.x * nodes.y;
        const Lines lines{nodes[axis], stride};
        // Columns of neighbouring lines; along x a line by itself.
        const std::int64_t width = axis == 0 ? 1 : nodes.x;
        const std::int64_t across = axis == 0 ? nodes.y : ceil_div(nodes.x, kColumns);
        const std::int64_t others = axis == 1 ? nodes.z : axis == 2 ? nodes.y : nodes.z;
        tbb::parallel_for(std::int64_t{0}, across * others, [&](std::int64_t i) {
            const std::int64_t a = i % across;
            const std::int64_t b = i / across;
            const std::int64_t x = axis == 0 ? 0 : a * kColumns;
            const Int3 p = axis == 0 ? Int3{0, a, b} : axis == 1 ? Int3{x, 0, b} : Int3{x, b, 0};
            convolve(values.data() + nodes.linear(p), lines,
                     axis == 0 ? 1 : std::min(kColumns, width - x), weights, buffers.local());
        });
    }
}

}  // namespace isonest::detail
