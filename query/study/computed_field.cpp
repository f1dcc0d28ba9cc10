#include "query/study/computed_field.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <isonest/error.h>

#include "query/study/cell_indicators.h"
#include "query/study/support_measure.h"
#include "query/study/whole_lattice.h"
#include "query/traverse/adapt_traverse.h"
#include "query/values/label_view.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "store/lattice/children.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

/// The odd axes of a node of scale 1 (bits).
unsigned odd_axes(const Int3& p) {
    return static_cast<unsigned>((p.x & 1) | (p.y & 1) << 1 | (p.z & 1) << 2);
}

/// Calls f(t, children) for all elements between the one cube of `lattice` and its subcubes.
template <int D, class F>
void for_bisections(const Lattice& lattice, const F& f) {
    std::vector<Element<D>> left = coarsest_elements<D>(lattice);
    while (!left.empty()) {
        const Element<D> t = left.back();
        left.pop_back();
        if (t.level == 0) {
            continue;
        }
        const std::array<Element<D>, 2> halves = t.bisect(0);
        f(t, halves);
        left.insert(left.end(), halves.begin(), halves.end());
    }
}

template <int D>
Simplex simplex_of(const Element<D>& t, const Double3& spacing, unsigned flat) {
    Simplex simplex;
    simplex.vertices = D + 1;
    simplex.flat = flat;
    for (std::size_t i = 0; i < t.v.size(); ++i) {
        for (std::size_t a = 0; a < 3; ++a) {
            simplex.v[i][a] = static_cast<double>(t.v[i][static_cast<int>(a)]) * spacing[a];
        }
    }
    return simplex;
}

/// Factors of the elements that are refined at the nodes of a cube of edge 2 whose even coordinates
/// are 0: the others are mirror images.
template <int D>
void sum_factors(const Lattice& lattice, const Double3& spacing, double power,
                 std::array<double, 8>& size, std::array<double, 8>& hat) {
    const Int3 nodes{lattice.nodes().x > 1 ? 3 : 1, lattice.nodes().y > 1 ? 3 : 1,
                     lattice.nodes().z > 1 ? 3 : 1};
    const Lattice cube(nodes);
    for_bisections<D>(cube, [&](const Element<D>& t, const std::array<Element<D>, 2>& halves) {
        const Int3 x = t.ref_node();
        if (std::max({x.x, x.y, x.z}) > 1) {
            return;
        }
        const unsigned odd = odd_axes(x);
        size[odd] += simplex_of(t, spacing, lattice.flat_axes()).measure();
        for (const Element<D>& half : halves) {
            const Simplex simplex = simplex_of(half, spacing, lattice.flat_axes());
            const auto vertex = static_cast<std::size_t>(
                std::find(half.v.begin(), half.v.end(), x) - half.v.begin());
            const double slope = length(simplex.gradient_weights()[vertex]);
            if (std::isinf(power)) {
                hat[odd] = std::max(hat[odd], slope);
            } else {
                hat[odd] += simplex.measure() * std::pow(slope, power);
            }
        }
    });
}

}  // namespace

OffsetFactors::OffsetFactors(const Lattice& lattice, const Double3& spacing,
                             const ComputedField& field)
    : lattice_(lattice),
      power_(field.power),
      gradient_(field.indicator == ComputedIndicator::grad_lp),
      dimension_(lattice.dimension()) {
    switch (dimension_) {
        case 1:
            sum_factors<1>(lattice, spacing, power_, size_, hat_);
            break;
        case 2:
            sum_factors<2>(lattice, spacing, power_, size_, hat_);
            break;
        default:
            sum_factors<3>(lattice, spacing, power_, size_, hat_);
    }
}

double OffsetFactors::of(const Int3& p, const NodeInfo& node) const {
    const Int3 cells = lattice_.cells_at(node.level());
    std::int64_t cubes = 1;
    unsigned odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        odd |= node.odd[a] ? 1U << a : 0;
        if (!node.odd[a] && cells[axis] > 0) {
            // Number of cubes before and after the node.
            const std::int64_t at = p[axis] / (2 * node.scale);
            cubes *= (at > 0 ? 1 : 0) + (at < cells[axis] ? 1 : 0);
        }
    }
    const auto count = static_cast<double>(cubes);
    const auto scale = static_cast<double>(node.scale);
    if (std::isinf(power_)) {
        return gradient_ ? hat_[odd] / scale : 1;
    }
    if (gradient_) {
        return std::pow(count * hat_[odd] * std::pow(scale, dimension_ - power_), 1 / power_);
    }
    return std::pow(count * size_[odd] * std::pow(scale, dimension_), 1 / power_) /
           (dimension_ + 1);
}

namespace {

constexpr float kMissing = std::numeric_limits<float>::infinity();

/// First and second derivatives of U on the finest lattice, by central differences; at the border
/// those of the nearest nodes with neighbours.
class Derivatives {
  public:
    Derivatives(const WholeLattice& whole, const Double3& spacing)
        : whole_(whole), spacing_(spacing), last_(whole.lattice().nodes() - Int3{1, 1, 1}) {}

    [[nodiscard]] Double3 gradient(const Int3& node) const {
        const Int3 p = min(node, last_);
        Double3 g{};
        for (int axis = 0; axis < 3; ++axis) {
            if (last_[axis] > 0) {
                const auto [low, high] = around(p, axis);
                g[static_cast<std::size_t>(axis)] =
                    (whole_.exact(high) - whole_.exact(low)) / distance(low, high, axis);
            }
        }
        return g;
    }
    /// The root of the sum of all squared curvatures of the graph: of its shape operator
    /// (I + g g^T)^-1 H / sqrt(1 + |g|^2), with g the gradient and H the second derivatives, the
    /// sum of the squared eigenvalues is the trace of its square.
    [[nodiscard]] double graph_curvature(const Int3& node) const {
        const Double3 g = gradient(node);
        const std::array<Double3, 3> h = second_derivatives(node);
        const double square = 1 + dot(g, g);
        std::array<Double3, 3> shape{};
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                shape[i][j] = (h[i][j] - g[i] * dot(g, h[j]) / square) / std::sqrt(square);
            }
        }
        double trace = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                trace += shape[i][j] * shape[j][i];
            }
        }
        return std::isnan(trace) ? trace : std::sqrt(std::max(trace, 0.0));
    }
    /// sqrt(k1^2 + k2^2) = |P H P| / |grad U| in the Frobenius norm, where P projects along the
    /// gradient (the shape operator of a level set).
    [[nodiscard]] double curvature(const Int3& node) const {
        const Double3 g = gradient(node);
        const double size = length(g);
        if (!(size > 0)) {
            return std::isnan(size) ? size : 0;
        }
        const std::array<Double3, 3> h = second_derivatives(node);
        std::array<Double3, 3> project{};
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                project[i][j] = (i == j ? 1 : 0) - g[i] * g[j] / (size * size);
            }
        }
        double square = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                double entry = 0;
                for (std::size_t k = 0; k < 3; ++k) {
                    entry += project[i][k] * dot(h[k], project[j]);
                }
                square += entry * entry;
            }
        }
        return std::sqrt(square) / size;
    }

  private:
    [[nodiscard]] std::pair<Int3, Int3> around(const Int3& p, int axis) const {
        std::pair<Int3, Int3> ends{p, p};
        ends.first[axis] = std::max<std::int64_t>(p[axis] - 1, 0);
        ends.second[axis] = std::min(p[axis] + 1, last_[axis]);
        return ends;
    }
    [[nodiscard]] double distance(const Int3& low, const Int3& high, int axis) const {
        return static_cast<double>(high[axis] - low[axis]) *
               spacing_[static_cast<std::size_t>(axis)];
    }
    [[nodiscard]] std::array<Double3, 3> second_derivatives(const Int3& node) const {
        std::array<Double3, 3> h{};
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                h[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = second(node, i, j);
            }
        }
        return h;
    }
    [[nodiscard]] double second(const Int3& node, int i, int j) const {
        if (last_[i] < 2 || last_[j] < 2) {
            return 0;
        }
        Int3 p = min(node, last_);
        for (const int axis : {i, j}) {
            p[axis] = std::clamp<std::int64_t>(p[axis], 1, last_[axis] - 1);
        }
        const auto [low, high] = around(p, i);
        const double step = distance(low, high, i);
        if (i == j) {
            return (whole_.exact(high) - 2 * whole_.exact(p) + whole_.exact(low)) /
                   (step * step / 4);
        }
        const auto slope = [&](const Int3& q) {
            const auto [from, to] = around(q, j);
            return (whole_.exact(to) - whole_.exact(from)) / distance(from, to, j);
        };
        return (slope(high) - slope(low)) / step;
    }

    const WholeLattice& whole_;
    Double3 spacing_;
    Int3 last_;
};

/// Calls f(p, node, row) for the refinement nodes of a level, in parallel. `row`: the number of
/// their row along x.
template <class F>
void for_nodes_of(const Lattice& lattice, int level, Progress& progress, const F& f) {
    const std::int64_t scale = std::int64_t{1} << (level - 1);
    const Int3 size = lattice.cells_at(level) * 2 + Int3{1, 1, 1};
    tbb::parallel_for(std::int64_t{0}, size.y * size.z, [&](std::int64_t row) {
        progress.check();
        for (std::int64_t x = 0; x < size.x; ++x) {
            const Int3 p = Int3{x, row % size.y, row / size.y} * scale;
            const NodeInfo node = describe_node(p, lattice.top());
            if (node.scale == scale) {
                f(p, node, static_cast<std::size_t>(row));
            }
        }
    });
}

}  // namespace

double compute_indicator(WholeLattice& whole, const ComputedField& field, const Double3& spacing,
                         Progress& progress) {
    if (is_of_cells(field.indicator)) {
        return compute_cell_indicator(whole, field, spacing, progress);
    }
    const Lattice& lattice = whole.lattice();
    const bool by_offset =
        field.indicator == ComputedIndicator::lp || field.indicator == ComputedIndicator::grad_lp;
    std::optional<OffsetFactors> factors;
    if (by_offset && lattice.dimension() > 0) {
        factors.emplace(lattice, spacing, field);
    }
    const SupportMeasure deviation = measures_support(field.indicator)
                                         ? measure_of_support(whole, field, spacing, progress)
                                         : SupportMeasure();
    const Derivatives derivatives(whole, spacing);
    const auto raw = [&](const Int3& p, const NodeInfo& node) {
        const double offset =
            whole.exact(p) - (whole.exact(node.end0) + whole.exact(node.end1)) / 2;
        if (!std::isfinite(offset)) {
            return kMissing;
        }
        double eta = 0;
        switch (field.indicator) {
            case ComputedIndicator::lp:
            case ComputedIndicator::grad_lp:
                eta = std::fabs(offset) * factors->of(p, node);
                break;
            case ComputedIndicator::gradient:
                eta = length(derivatives.gradient(p));
                break;
            case ComputedIndicator::curvature:
                eta = derivatives.curvature(p);
                break;
            case ComputedIndicator::graph_curvature:
                eta = derivatives.graph_curvature(p);
                break;
            case ComputedIndicator::deviation_lp:
            case ComputedIndicator::deviation_grad_lp:
            case ComputedIndicator::deviation_graph:
                eta = deviation(p, node);
                break;
            case ComputedIndicator::hex_lp:
            case ComputedIndicator::hex_grad_lp:
                break;  // of cells, not of nodes
        }
        return std::isfinite(eta) ? static_cast<float>(eta) : kMissing;
    };
    for (int level = 1; level <= lattice.top(); ++level) {
        for_nodes_of(lattice, level, progress, [&](const Int3& p, const NodeInfo& node, auto) {
            whole.set_indicator(p, raw(p, node));
        });
        for (const NodeKind kind : {NodeKind::edge, NodeKind::face, NodeKind::centre}) {
            for_nodes_of(lattice, level, progress, [&](const Int3& p, const NodeInfo& node, auto) {
                if (!field.saturation || node.kind != kind) {
                    return;
                }
                float most = 0;
                for_children(lattice, p, node, [&](const Int3& child) {
                    most = std::max(most, whole.indicator(child));
                });
                const float eta = whole.indicator(p);
                const bool bar = *field.saturation == Saturation::bar;
                whole.set_indicator(p, bar ? std::max(eta, most) : eta + most);
            });
        }
    }
    double largest = 0;
    for (int level = 1; level <= lattice.top(); ++level) {
        const Int3 size = lattice.cells_at(level) * 2 + Int3{1, 1, 1};
        std::vector<float> rows(static_cast<std::size_t>(size.y * size.z), 0);
        for_nodes_of(lattice, level, progress,
                     [&](const Int3& p, const NodeInfo&, std::size_t row) {
                         const float eta = whole.indicator(p);
                         rows[row] = std::isfinite(eta) ? std::max(rows[row], eta) : rows[row];
                     });
        largest =
            std::max(largest, static_cast<double>(*std::max_element(rows.begin(), rows.end())));
    }
    return largest;
}

void export_computed_field(const StoreReader& store, const std::filesystem::path& path,
                           const ExportOptions& options, Progress& progress) {
    require_numbers(store, "an indicator");
    const auto& field = std::get<ComputedField>(options.field);
    if (is_of_cells(field.indicator)) {
        throw Error(ErrorKind::invalid_argument, {store.path().string()},
                    name_of(field) + " is not an indicator of nodes");
    }
    check_output(path, options.force, {store.path()});
    const StoreLayout& layout = store.layout();
    const StoreHeader& header = layout.header();
    if (options.level > layout.lattice().top()) {
        // Throws an error that lists the existing levels.
        static_cast<void>(layout.array(options.level, Field::values));
    }
    const Int3 n = header.nodes;
    const std::uint64_t largest = largest_chunk_bytes(layout);
    const std::uint64_t fixed = kLibraryHeap + decode_heap(largest) + 2 * largest +
                                static_cast<std::uint64_t>(n.x * n.y) * sizeof(float);
    const std::uint64_t least = WholeLattice::heap(layout) + fixed;
    require_memory(store.path().string(), options.memory, least,
                   "an indicator that is computed for the whole volume");
    constexpr const char* kWhat = "an indicator that is computed for the whole volume";
    require_right_angles(header.direction, store.path().string(), kWhat);
    require_even_axes(header, store.path().string(), kWhat);
    VolumeFileSpec spec;
    spec.nodes = n;
    spec.type = ValueType::f32;
    spec.spacing = header.spacing;
    spec.origin = header.origin;
    spec.direction = header.direction;
    spec.unit = header.unit;
    spec.frame = header.frame;
    spec.force = options.force;
    const auto file = create_volume_file(path, spec);
    WholeLattice whole(layout);
    {
        ChunkCache cache(store, 2 * largest);
        whole.load_values(cache);
    }
    compute_indicator(whole, field, header.spacing, progress);
    progress.begin("export", static_cast<std::uint64_t>(n.z), "planes");
    std::vector<float> plane(static_cast<std::size_t>(n.x * n.y));
    for (std::int64_t z = 0; z < n.z; ++z) {
        progress.check();
        for (std::int64_t i = 0; i < n.x * n.y; ++i) {
            const Int3 p{i % n.x, i / n.x, z};
            const NodeInfo node = describe_node(p, layout.lattice().top());
            const bool is_wanted = node.scale > 0 && node.level() >= options.level;
            plane[static_cast<std::size_t>(i)] = is_wanted ? whole.indicator(p) : 0;
        }
        file->write(reinterpret_cast<const std::byte*>(plane.data()), 1);
        progress.advance(1);
    }
    file->finish();
}

}  // namespace isonest::detail
