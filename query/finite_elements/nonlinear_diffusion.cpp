#include "query/finite_elements/nonlinear_diffusion.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/conjugate_gradients.h"
#include "query/finite_elements/grid_operator.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kColumns = 32;  ///< number of lines that are convolved side by side

/// Weights of the distances 0, 1, ..; the sum over both sides is 1.
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

/// Convolves `columns` neighbouring lines starting at `first`. `buffer`: all of them, with borders.
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
        // Columns of neighbouring lines; along x each line separately.
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

namespace {

constexpr std::int64_t kRowsInOneGo = 64;

template <class F>
void for_rows(std::int64_t rows, const F& f) {
    tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, rows, kRowsInOneGo), [&](const auto& r) {
        for (std::int64_t row = r.begin(); row < r.end(); ++row) {
            f(row);
        }
    });
}

/// Computes the inactive refinement nodes of one slot from the nodes of coarser levels.
template <class Real>
void prolong_slot(const Lattice& lattice, const NodeSet& set, int level, int slot,
                  std::span<Real> all) {
    const Int3 nodes = lattice.nodes();
    const SlotRows slot_rows(lattice, level, slot);
    for_rows(slot_rows.rows(), [&](std::int64_t row) {
        const Int3 first = slot_rows.first_of(row);
        const Int3 half = slot_rows.half_edge(0, first);
        const auto from = [&](std::int64_t y, std::int64_t z) {
            return all.data() + nodes.linear({0, y, z});
        };
        const std::span<const std::uint64_t> active = set.row_words(first.y, first.z);
        Real* const to = from(first.y, first.z);
        const Real* const end0 = from(first.y - half.y, first.z - half.z);
        const Real* const end1 = from(first.y + half.y, first.z + half.z);
        for (std::int64_t i = 0, x = first.x; i < slot_rows.count.x;
             ++i, x += 2 * slot_rows.scale) {
            if ((active[static_cast<std::size_t>(x / 64)] >> static_cast<unsigned>(x % 64) & 1U) ==
                0) {
                const std::int64_t by = i % 2 != 0 ? -half.x : half.x;
                to[x] = Real{0.5} * end0[x - by] + Real{0.5} * end1[x + by];
            }
        }
    });
}

}  // namespace

void restrict_to(const NodeSet& set, std::span<const float> all, std::span<float> active) {
    const Int3 nodes = set.nodes();
    for_rows(nodes.y * nodes.z, [&](std::int64_t row) {
        const float* const from = all.data() + row * nodes.x;
        set.for_row({0, row % nodes.y, row / nodes.y}, nodes.x,
                    [&](std::int64_t x, std::uint64_t number) { active[number] = from[x]; });
    });
}

template <class Real>
void prolong(const Lattice& lattice, const NodeSet& set, std::span<const Real> active,
             std::span<Real> all) {
    const Int3 nodes = set.nodes();
    for_rows(nodes.y * nodes.z, [&](std::int64_t row) {
        Real* const to = all.data() + row * nodes.x;
        set.for_row({0, row % nodes.y, row / nodes.y}, nodes.x,
                    [&](std::int64_t x, std::uint64_t number) { to[x] = active[number]; });
    });
    if (set.is_full()) {
        return;
    }
    for (int level = lattice.top(); level >= 1; --level) {
        for (int slot = 0; slot < kSlots; ++slot) {
            if ((static_cast<unsigned>(slot + 1) & lattice.flat_axes()) == 0) {
                prolong_slot(lattice, set, level, slot, all);
            }
        }
    }
}

template void prolong(const Lattice&, const NodeSet&, std::span<const float>, std::span<float>);
template void prolong(const Lattice&, const NodeSet&, std::span<const double>, std::span<double>);

namespace {

/// Sums of a function over the volume by the lumped mass matrix.
struct Moments {
    double mean = 0;
    double variance = 0;
};

Moments moments(std::span<const float> mass, std::span<const float> u) {
    const auto m = [&](std::size_t i) { return static_cast<double>(mass[i]); };
    const double volume = sum_of(u.size(), m);
    Moments out;
    out.mean =
        sum_of(u.size(), [&](std::size_t i) { return m(i) * static_cast<double>(u[i]); }) / volume;
    out.variance = sum_of(u.size(),
                          [&](std::size_t i) {
                              const double d = static_cast<double>(u[i]) - out.mean;
                              return m(i) * d * d;
                          }) /
                   volume;
    return out;
}

/// Memory of a step, in vectors over the lattice: the values, G_sigma * u, r, p, z, two diagonals.
constexpr std::uint64_t kVectors = 7;
/// The same for a grid with fewer nodes: x, r, p, z, two diagonals and a matrix, at the active
/// nodes only; with nearly all nodes active the matrix takes as much as seven vectors.
constexpr std::uint64_t kVectorsOfFewer = 13;
constexpr std::uint64_t kVectorsBesideMatrix = 6;

/// tau B and the diagonals of M and tau B; nothing if they do not fit into the size given by
/// heap().
std::optional<GridMatrix<float>> assembled(const Lattice& lattice, GridOperator<float>& grid,
                                           const Coefficient<float>& a, double tau,
                                           std::span<float> mass, std::span<float> diagonal) {
    if (grid.nodes().is_full()) {
        return std::nullopt;  // the product without a matrix is as fast
    }
    const auto nodes = static_cast<std::uint64_t>(lattice.nodes().product());
    const std::uint64_t active = grid.nodes().count();
    const std::uint64_t most =
        (kVectorsOfFewer * nodes - kVectorsBesideMatrix * active) * sizeof(float);
    return grid.assemble(a, tau, mass, diagonal, most);
}

}  // namespace

NonlinearDiffusion::NonlinearDiffusion(const Lattice& lattice, const Double3& spacing,
                                       std::vector<float> values, const SmoothOptions& options)
    : lattice_(lattice), spacing_(spacing), values_(std::move(values)), options_(options) {
    assert(static_cast<std::int64_t>(values_.size()) == lattice.nodes().product());
    if (!options_.sigma) {
        double nearest = std::numeric_limits<double>::infinity();
        for (int axis = 0; axis < 3; ++axis) {
            const double s = spacing.at(static_cast<std::size_t>(axis));
            nearest = lattice.nodes()[axis] > 1 ? std::min(nearest, s) : nearest;
        }
        options_.sigma = nearest;
    }
}

NodeSet NonlinearDiffusion::grid(Progress& progress) const {
    return active_nodes<float>(lattice_, spacing_, values_, options_.threshold, options_.threads,
                               progress);
}

std::uint64_t NonlinearDiffusion::heap(const Lattice& lattice, const SmoothOptions& options) {
    const auto nodes = static_cast<std::uint64_t>(lattice.nodes().product());
    const std::uint64_t vectors = options.threshold > 0 ? kVectorsOfFewer : kVectors;
    const auto rows = static_cast<std::uint64_t>(lattice.nodes().y * lattice.nodes().z);
    const std::uint64_t grid =
        ((static_cast<std::uint64_t>(lattice.nodes().x) + 63) / 64 * 12 + 8) * rows;
    // the last term: the blocks during their construction
    return vectors * sizeof(float) * nodes + grid + nodes / 2;
}

SmoothStep NonlinearDiffusion::step(Progress& progress) {
    const NodeSet set = grid(progress);
    GridOperator<float> grid_operator(lattice_, spacing_, set, options_.threads);
    Workers& workers = grid_operator.workers();
    const auto n = static_cast<std::size_t>(set.count());

    // G_sigma * u at the active nodes.
    std::vector<float> smoothed = values_;
    workers.execute(
        [&] { smooth_gaussian(smoothed, lattice_.nodes(), spacing_, *options_.sigma); });
    const auto active = [&](std::vector<float>&& all) {
        if (set.is_full()) {
            return std::move(all);
        }
        std::vector<float> some(n);
        workers.execute([&] { restrict_to(set, all, some); });
        return some;
    };
    smoothed = active(std::move(smoothed));
    std::vector<float> x;
    if (set.is_full()) {
        x.swap(values_);
    } else {
        x.resize(n);
        workers.execute([&] { restrict_to(set, values_, x); });
        std::vector<float>().swap(values_);
    }

    const Coefficient<float> a{smoothed, options_.lambda};
    std::vector<float> mass(n);
    std::vector<float> diagonal(n);
    const std::optional<GridMatrix<float>> matrix =
        assembled(lattice_, grid_operator, a, options_.tau, mass, diagonal);
    std::vector<float> r(n);  // M u minus (M + tau B) u
    if (matrix) {
        smoothed = {};
        workers.execute([&] {
            matrix->multiply({}, x, r);
            for_parts(n, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) {
                    r[i] = -r[i];
                }
            });
        });
    } else {
        grid_operator.lumped_mass(mass);
        grid_operator.stiffness_diagonal(a, options_.tau, diagonal);
        grid_operator.stiffness(a, -options_.tau, x, r);
    }
    std::vector<float> p(n);
    std::vector<float> z(n);

    SmoothStep report;
    report.unknowns = set.count();
    const Moments before = workers.execute([&] { return moments(mass, x); });
    double scale = 0;
    workers.execute([&] {
        for_parts(n, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                diagonal[i] += mass[i];
            }
        });
        scale = std::sqrt(sum_of(n, [&](std::size_t i) {
            const double d =
                static_cast<double>(mass[i]) * (static_cast<double>(x[i]) - before.mean);
            return d * d / static_cast<double>(diagonal[i]);
        }));
    });
    const auto multiply = [&](std::span<const float> w, std::span<float> out) {
        if (matrix) {
            return workers.execute([&] { matrix->multiply(mass, w, out); });
        }
        grid_operator.stiffness(a, options_.tau, w, out);
        workers.execute([&] {
            for_parts(n, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) {
                    out[i] += mass[i] * w[i];
                }
            });
        });
    };
    const SolverReport solved = workers.execute([&] {
        return conjugate_gradients<float>(multiply, diagonal, {x, r, p, z},
                                          options_.tolerance * scale, options_.max_iterations,
                                          progress);
    });
    report.iterations = solved.iterations;
    report.residual = scale > 0 ? solved.residual / scale : 0;

    // Only the remaining residual could change the mean.
    const Moments after = workers.execute([&] { return moments(mass, x); });
    const auto shift = static_cast<float>(before.mean - after.mean);
    report.mean = before.mean;
    report.variance = after.variance;
    workers.execute([&] {
        for_parts(n, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                x[i] += shift;
            }
        });
    });
    const auto [least, largest] = std::minmax_element(x.begin(), x.end());
    report.least = static_cast<double>(*least);
    report.largest = static_cast<double>(*largest);
    if (set.is_full()) {
        values_.swap(x);
    } else {
        values_.resize(static_cast<std::size_t>(lattice_.nodes().product()));
        workers.execute([&] { prolong<float>(lattice_, set, x, values_); });
    }
    return report;
}

}  // namespace isonest::detail
