#include "query/finite_elements/nonlinear_diffusion.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <optional>
#include <utility>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/conjugate_gradients.h"
#include "query/finite_elements/gaussian.h"
#include "query/finite_elements/grid_operator.h"
#include "query/finite_elements/projection.h"

namespace isonest::detail {
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

/// In vectors over the lattice, what a step takes: the values, G_sigma * u, r, p, z, two diagonals.
constexpr std::uint64_t kVectors = 7;
/// The same on a grid of fewer nodes: x, r, p, z, two diagonals and a matrix, of the active nodes
/// alone; with all but a few active the matrix takes as much as seven.
constexpr std::uint64_t kVectorsOfFewer = 13;
constexpr std::uint64_t kVectorsBesideMatrix = 6;

/// tau B and the diagonals of M and tau B; nothing if they do not fit into what heap() promises.
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
                                       std::vector<float> values, const DiffusionOptions& options)
    : lattice_(lattice), spacing_(spacing), values_(std::move(values)), options_(options) {
    assert(static_cast<std::int64_t>(values_.size()) == lattice.nodes().product());
}

NodeSet NonlinearDiffusion::grid(Progress& progress) const {
    return active_nodes<float>(lattice_, spacing_, values_, options_.threshold, options_.threads,
                               progress);
}

std::uint64_t NonlinearDiffusion::heap(const Lattice& lattice, const DiffusionOptions& options) {
    const auto nodes = static_cast<std::uint64_t>(lattice.nodes().product());
    const std::uint64_t vectors = options.threshold > 0 ? kVectorsOfFewer : kVectors;
    const auto rows = static_cast<std::uint64_t>(lattice.nodes().y * lattice.nodes().z);
    const std::uint64_t grid =
        ((static_cast<std::uint64_t>(lattice.nodes().x) + 63) / 64 * 12 + 8) * rows;
    return vectors * sizeof(float) * nodes + grid + nodes / 2;  // the blocks while they are found
}

DiffusionStep NonlinearDiffusion::step(Progress& progress) {
    const NodeSet set = grid(progress);
    GridOperator<float> grid_operator(lattice_, spacing_, set, options_.threads);
    Workers& workers = grid_operator.workers();
    const auto n = static_cast<std::size_t>(set.count());

    // What G_sigma * u is, at the active nodes.
    std::vector<float> smoothed = values_;
    workers.execute([&] { smooth_gaussian(smoothed, lattice_.nodes(), spacing_, options_.sigma); });
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
    std::vector<float> r(n);  // M u less (M + tau B) u
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

    DiffusionStep report;
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
                                          options_.tolerance * scale, options_.most_iterations,
                                          progress);
    });
    report.iterations = solved.iterations;
    report.residual = scale > 0 ? solved.residual / scale : 0;

    // What the solver leaves of the residual is all that could change the mean.
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
        workers.execute([&] { prolong(lattice_, set, x, values_); });
    }
    return report;
}

}  // namespace isonest::detail
