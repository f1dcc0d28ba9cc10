#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <tsl/robin_map.h>

#include <cmath>
#include <utility>

#include <isonest/error.h>
#include <isonest/implicit_grid.h>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/grid_parts.h"
#include "query/finite_elements/linear_element.h"
#include "query/finite_elements/nonlinear_diffusion.h"
#include "query/values/node_fields.h"
#include "store/container/reader.h"

namespace isonest {

struct HashedNumbering::Table {
    using Pair = std::pair<std::uint64_t, std::uint64_t>;
    struct Hash {
        std::size_t operator()(const Pair& p) const {
            std::uint64_t h = p.first * 0x9E3779B97F4A7C15U + p.second;
            h = (h ^ (h >> 30U)) * 0xBF58476D1CE4E5B9U;
            return h ^ (h >> 29U);
        }
    };
    using Map = tsl::robin_map<Pair, std::uint64_t, Hash>;

    Map numbers;

    std::uint64_t number(const Pair& parents) {
        return numbers.try_emplace(parents, numbers.size()).first->second;
    }
};

HashedNumbering::HashedNumbering() : table_(std::make_unique<Table>()) {}
HashedNumbering::HashedNumbering(HashedNumbering&& other) noexcept = default;
HashedNumbering& HashedNumbering::operator=(HashedNumbering&& other) noexcept = default;
HashedNumbering::~HashedNumbering() = default;

std::uint64_t HashedNumbering::corner(const Int3& p) {
    // No pair has such a large first number.
    constexpr std::uint64_t kCorner = std::uint64_t{1} << 63U;
    const auto place =
        static_cast<std::uint64_t>((p.x != 0 ? 1 : 0) + (p.y != 0 ? 2 : 0) + (p.z != 0 ? 4 : 0));
    return table_->number({kCorner, place});
}
std::uint64_t HashedNumbering::middle(std::uint64_t a, std::uint64_t b, const Int3& /*p*/) {
    return table_->number(std::minmax(a, b));
}
std::uint64_t HashedNumbering::count() const {
    return table_->numbers.size();
}
std::uint64_t HashedNumbering::heap() const {
    // A bucket has the entry and its distance from its ideal position.
    return table_->numbers.bucket_count() *
           (sizeof(Table::Map::value_type) + sizeof(std::uint64_t));
}

namespace detail {

NodeSet every_node(const Lattice& lattice) {
    const Int3 n = lattice.nodes();
    NodeSet set(n);
    for (std::int64_t row = 0; row < n.y * n.z; ++row) {
        const auto words = set.row_words(row % n.y, row / n.y);
        std::fill(words.begin(), words.end(), ~std::uint64_t{0});
        if (n.x % 64 != 0) {
            words.back() = (std::uint64_t{1} << static_cast<unsigned>(n.x % 64)) - 1;
        }
    }
    set.finish();
    return set;
}

namespace {

/// Positions of shapes in a table: by level, kind, order of the axes, and directions along them.
template <int D>
struct ShapeTable {
    static constexpr std::size_t kOrders = D == 3 ? 27 : D == 2 ? 9 : 3;
    static constexpr std::size_t kDirections = std::size_t{1} << static_cast<unsigned>(D);
    static constexpr std::size_t kPerLevel = D * kOrders * kDirections;

    /// `negative`: bits of the element's own directions that run towards smaller coordinates.
    static std::size_t at(int level, int kind, const ElementAxes<D>& axes, unsigned negative) {
        std::size_t order = 0;
        for (const int axis : axes) {
            order = 3 * order + static_cast<std::size_t>(axis);
        }
        return ((static_cast<std::size_t>(level) * D + static_cast<std::size_t>(kind)) * kOrders +
                order) *
                   kDirections +
               negative;
    }
};

/// The own directions of an element that run towards smaller coordinates. coordinate(i, axis): that
/// of vertex i.
template <int D, int Kind, class Coordinate>
unsigned negative_directions(const ElementAxes<D>& axes, const Coordinate& coordinate) {
    constexpr auto kWeights = derivative_weights<D, Kind>();
    unsigned negative = 0;
    for (std::size_t j = 0; j < D; ++j) {
        std::int64_t step = 0;
        for (std::size_t i = 0; i <= D; ++i) {
            if (kWeights[j][i] != 0) {
                step += kWeights[j][i] * coordinate(i, axes[j]);
            }
        }
        negative |= step < 0 ? 1U << static_cast<unsigned>(j) : 0U;
    }
    return negative;
}

template <int D, int Kind>
void fill_shapes(const GridParts<D>& grid, int level, std::vector<ElementShape<D>>& shapes) {
    constexpr auto kWeights = derivative_weights<D, Kind>();
    double measure = D == 3 ? 1.0 / 6 : D == 2 ? 0.5 : 1;
    for (unsigned axis = 0; axis < 3; ++axis) {
        measure *= (grid.lattice.flat_axes() >> axis & 1U) != 0 ? 1 : grid.spacing[axis];
    }
    for (const ElementAxes<D>& axes : axis_orders<D>(grid.lattice)) {
        for (unsigned negative = 0; negative < ShapeTable<D>::kDirections; ++negative) {
            ElementShape<D> s;
            s.level = level;
            s.kind = Kind;
            s.measure = std::ldexp(measure, D * level - Kind);
            for (std::size_t j = 0; j < D; ++j) {
                const auto axis = static_cast<std::size_t>(axes[j]);
                const double edge = std::ldexp(grid.spacing[axis], level);
                for (std::size_t i = 0; i <= D; ++i) {
                    s.gradient[i][axis] =
                        ((negative >> j & 1U) != 0 ? -kWeights[j][i] : kWeights[j][i]) / edge;
                }
            }
            shapes[ShapeTable<D>::at(level, Kind, axes, negative)] = s;
        }
    }
}

/// The shape of an element whose coordinates are given as above.
template <int D, int Kind, class Coordinate>
const ElementShape<D>* shape_of(const GridParts<D>& grid, int level, const ElementAxes<D>& axes,
                                const Coordinate& coordinate) {
    const unsigned negative = negative_directions<D, Kind>(axes, coordinate);
    return &grid.shapes[ShapeTable<D>::at(level, Kind, axes, negative)];
}

template <int D, int Kind>
const ElementShape<D>* shape_of(const GridParts<D>& grid, const Element<D>& t) {
    return shape_of<D, Kind>(grid, t.level, axes_of(t),
                             [&](std::size_t i, int axis) { return t.v[i][axis]; });
}

template <int D>
const ElementShape<D>* shape_of_any_kind(const GridParts<D>& grid, const Element<D>& t) {
    if constexpr (D >= 2) {
        if (t.kind == 1) {
            return shape_of<D, 1>(grid, t);
        }
    }
    if constexpr (D == 3) {
        if (t.kind == 2) {
            return shape_of<D, 2>(grid, t);
        }
    }
    return shape_of<D, 0>(grid, t);
}

/// Collects elements and passes them on, some at a time.
template <int D>
class Collector {
  public:
    using Batch = std::function<void(std::span<const GridElement<D>>)>;
    explicit Collector(const Batch& batch) : batch_(batch) { found_.reserve(kBatch); }

    /// The place of the next element.
    GridElement<D>& next() {
        if (found_.size() == kBatch) {
            flush();
        }
        return found_.emplace_back();
    }
    void flush() {
        if (!found_.empty()) {
            batch_(found_);
            found_.clear();
        }
    }

  private:
    static constexpr std::size_t kBatch = 128;
    const Batch& batch_;
    std::vector<GridElement<D>> found_;
};

/// The elements of a block with their numbered nodes.
template <int D>
class NumberedBlock {
  public:
    NumberedBlock(const GridParts<D>& grid, const BlockCommon<float, D>& common,
                  const typename Collector<D>::Batch& batch)
        : grid_(grid),
          common_(common),
          nodes_(common),
          number_(nodes_.block.layout.size()),
          found_(batch) {
        if constexpr (D == 3) {
            for (unsigned parity = 0; parity < 8; ++parity) {
                const auto bit = [&](int axis) {
                    return static_cast<std::int64_t>(parity >> static_cast<unsigned>(axis) & 1U);
                };
                for (std::size_t walk = 0; walk < kWalks; ++walk) {
                    const ElementAxes<D>& axes = common.walks[walk];
                    Walk& w = finest_.at(parity).at(walk);
                    Int3 p{bit(0), bit(1), bit(2)};
                    w.step[0] = p;
                    for (std::size_t i = 0; i < D; ++i) {
                        p[axes[i]] = 1 - p[axes[i]];
                        w.step.at(i + 1) = p;
                    }
                    w.shape = shape_of<D, 0>(
                        grid, 0, axes, [&](std::size_t i, int axis) { return w.step.at(i)[axis]; });
                }
            }
        }
    }

    void operator()(const Int3& corner, std::uint32_t elements) {
        nodes_.gather(corner);
        nodes_.for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t n) {
                number_[first + BlockLayout<D>::in_row(static_cast<std::uint32_t>(x - p.x))] = n;
            });
        });
        if constexpr (D == 3) {
            add_finest();
        }
        AddsLeaf add{*this};
        nodes_.visit(elements, add);
        found_.flush();
    }

  private:
    static constexpr std::size_t kWalks = 6;
    /// An element of a cell of the finest lattice.
    struct Walk {
        std::array<Int3, 4> step;  ///< vertices relative to the cell's corner
        const ElementShape<D>* shape = nullptr;
    };
    struct AddsLeaf {
        NumberedBlock& to;

        template <int Kind>
        void operator()(const BlockVertices<D>& v, const ElementAxes<D>& axes, int level) {
            GridElement<D>& t = to.found_.next();
            for (std::size_t i = 0; i <= D; ++i) {
                t.vertex[i] = to.nodes_.block.corner + Int3{coordinate(v[i].node, 0),
                                                            coordinate(v[i].node, 1),
                                                            coordinate(v[i].node, 2)};
                t.node[i] = to.number_[v[i].at];
            }
            t.shape = shape_of<D, Kind>(to.grid_, level, axes,
                                        [&](std::size_t i, int axis) { return t.vertex[i][axis]; });
        }
    };

    /// The six elements of each cell of the finest lattice: each exists if the end of its first
    /// step is active.
    void add_finest() {
        const LocalBlock<float, D>& block = nodes_.block;
        const Int3 cells = block.last;
        for (std::int64_t z = 0; z < cells.z; ++z) {
            for (std::int64_t y = 0; y < cells.y; ++y) {
                for (std::int64_t x = 0; x < cells.x; ++x) {
                    const Int3 cell{x, y, z};
                    for (const Walk& w : finest_.at(
                             static_cast<std::size_t>((x & 1) + 2 * (y & 1) + 4 * (z & 1)))) {
                        if (block.active[at(cell + w.step[1])] == 0) {
                            continue;
                        }
                        GridElement<D>& t = found_.next();
                        for (std::size_t i = 0; i <= D; ++i) {
                            const Int3 p = cell + w.step.at(i);
                            t.vertex[i] = block.corner + p;
                            t.node[i] = number_[at(p)];
                        }
                        t.shape = w.shape;
                    }
                }
            }
        }
    }
    [[nodiscard]] std::uint32_t at(const Int3& p) const {
        return nodes_.block.layout.row(static_cast<std::uint32_t>(p.y),
                                       static_cast<std::uint32_t>(p.z)) +
               BlockLayout<D>::in_row(static_cast<std::uint32_t>(p.x));
    }

    const GridParts<D>& grid_;
    const BlockCommon<float, D>& common_;
    BlockNodes<false, false, float, D> nodes_;
    std::vector<std::uint64_t> number_;               ///< of the block's active nodes
    std::array<std::array<Walk, kWalks>, 8> finest_;  ///< by the parities of the cell
    Collector<D> found_;
};

void require_lattice(const Int3& nodes, const Double3& spacing, int dimension) {
    int axes = 0;
    for (int axis = 0; axis < 3; ++axis) {
        if (nodes[axis] < 1 || nodes[axis] > kMaxNodesPerAxis) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("a grid needs 1 to {} nodes along each axis, not {}",
                                    kMaxNodesPerAxis, nodes[axis]));
        }
        axes += nodes[axis] > 1 ? 1 : 0;
        const double s = spacing[static_cast<std::size_t>(axis)];
        if (!(s > 0) || !std::isfinite(s)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("the spacing {} is not positive and finite", s));
        }
    }
    if (axes != dimension) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("a lattice of {} x {} x {} nodes extends along {} axes, not {}",
                                nodes.x, nodes.y, nodes.z, axes, dimension));
    }
}

/// The grid of ImplicitGrid::of_values().
template <int D, class Real>
std::shared_ptr<const GridParts<D>> grid_of_values(const Int3& nodes, const Double3& spacing,
                                                   std::span<const Real> values, double threshold,
                                                   int threads, Progress& progress) {
    require_lattice(nodes, spacing, D);
    const Lattice lattice(nodes);
    if (values.size() != static_cast<std::size_t>(lattice.nodes().product())) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("the lattice has {} nodes, but there are {} values",
                                lattice.nodes().product(), values.size()));
    }
    if (!(threshold >= 0) || !std::isfinite(threshold)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("the threshold {} is negative or not finite", threshold));
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("the value of node {} is not finite", i));
        }
    }
    return std::make_shared<GridParts<D>>(
        lattice, spacing,
        active_nodes<Real>(lattice, spacing, values, threshold, threads, progress), threads);
}

}  // namespace

template <int D>
GridParts<D>::GridParts(const Lattice& on, const Double3& steps, NodeSet set, int thread_count)
    : lattice(on),
      spacing(steps),
      threads(thread_count),
      nodes(std::move(set)),
      blocks(find_blocks<D>(lattice, nodes)),
      shapes(static_cast<std::size_t>(lattice.top() + 1) * ShapeTable<D>::kPerLevel),
      workers(thread_count) {
    for (int level = 0; level <= lattice.top(); ++level) {
        fill_shapes<D, 0>(*this, level, shapes);
        if constexpr (D >= 2) {
            fill_shapes<D, 1>(*this, level, shapes);
        }
        if constexpr (D == 3) {
            fill_shapes<D, 2>(*this, level, shapes);
        }
    }
}

template struct GridParts<1>;
template struct GridParts<2>;
template struct GridParts<3>;

}  // namespace detail

using detail::GridParts;
using detail::Lattice;

template <int D>
ImplicitGrid<D>::ImplicitGrid(const Int3& nodes, const Double3& spacing, int threads) {
    detail::require_lattice(nodes, spacing, D);
    const Lattice lattice(nodes);
    parts_ = std::make_shared<GridParts<D>>(lattice, spacing, detail::every_node(lattice), threads);
}

template <int D>
ImplicitGrid<D> ImplicitGrid<D>::of_nodes(const Int3& nodes, const Double3& spacing,
                                          const std::function<bool(const Int3&, int)>& wanted,
                                          int threads, Progress& progress) {
    detail::require_lattice(nodes, spacing, D);
    const Lattice lattice(nodes);
    ImplicitGrid grid;
    grid.parts_ = std::make_shared<GridParts<D>>(
        lattice, spacing, detail::active_nodes(lattice, wanted, threads, progress), threads);
    return grid;
}

template <int D>
ImplicitGrid<D> ImplicitGrid<D>::of_values(const Int3& nodes, const Double3& spacing,
                                           std::span<const double> values, double threshold,
                                           int threads, Progress& progress) {
    ImplicitGrid grid;
    grid.parts_ = detail::grid_of_values<D>(nodes, spacing, values, threshold, threads, progress);
    return grid;
}

template <int D>
ImplicitGrid<D> ImplicitGrid<D>::of_values(const Int3& nodes, const Double3& spacing,
                                           std::span<const float> values, double threshold,
                                           int threads, Progress& progress) {
    ImplicitGrid grid;
    grid.parts_ = detail::grid_of_values<D>(nodes, spacing, values, threshold, threads, progress);
    return grid;
}

template <int D>
ImplicitGrid<D> ImplicitGrid<D>::of_store(const Store& store, Field field, double threshold,
                                          int threads, Progress& progress) {
    constexpr std::uint64_t kCache = std::uint64_t{1} << 28U;
    detail::require_lattice(store.nodes(), store.spacing(), D);
    if (store.reader().layout().header().is_sheared()) {
        throw Error(ErrorKind::unsupported, {store.path().string()},
                    "the volume is sheared, and elements are computed for axes at right angles");
    }
    detail::require_even_axes(store.reader().layout().header(), store.path().string(),
                              "an implicit grid");
    detail::require_field_of_nodes(store.reader(), field);
    const Lattice& lattice = store.reader().layout().lattice();
    detail::ChunkCache cache(store.reader(), kCache);
    ImplicitGrid grid;
    grid.parts_ = std::make_shared<GridParts<D>>(
        lattice, store.spacing(), detail::active_nodes(cache, field, threshold, threads, progress),
        threads);
    return grid;
}

template <int D>
const NodeSet& ImplicitGrid<D>::nodes() const {
    return parts_->nodes;
}
template <int D>
const Double3& ImplicitGrid<D>::spacing() const {
    return parts_->spacing;
}
template <int D>
int ImplicitGrid<D>::levels() const {
    return parts_->lattice.top() + 1;
}
template <int D>
int ImplicitGrid<D>::threads() const {
    return parts_->threads;
}

template <int D>
void ImplicitGrid<D>::visit(const Batch& batch) const {
    const GridParts<D>& grid = *parts_;
    detail::Collector<D> coarse(batch);
    detail::for_coarse_leaves<D>(grid.lattice, grid.nodes, grid.blocks.level,
                                 [&]<int Kind>(const Element<D>& leaf) {
                                     GridElement<D>& t = coarse.next();
                                     t.vertex = leaf.v;
                                     for (std::size_t i = 0; i <= D; ++i) {
                                         t.node[i] = grid.nodes.number(leaf.v[i]);
                                     }
                                     t.shape = detail::shape_of<D, Kind>(grid, leaf);
                                 });
    coarse.flush();
    const auto common = detail::block_common<float, D>(grid.lattice, grid.nodes, grid.blocks.level);
    grid.workers.execute([&] {
        using Block = detail::NumberedBlock<D>;
        tbb::enumerable_thread_specific<Block> blocks([&] { return Block(grid, common, batch); });
        for (const auto& same : grid.blocks.groups) {
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, same.size()), [&](const auto& r) {
                Block& block = blocks.local();
                for (std::size_t i = r.begin(); i < r.end(); ++i) {
                    const auto& c = same[i].corner;
                    block({c[0], c[1], c[2]}, same[i].elements);
                }
            });
        }
    });
}

template <int D>
void ImplicitGrid<D>::visit(HashedNumbering& numbering, const Batch& batch) const {
    const GridParts<D>& grid = *parts_;
    const detail::ActiveNumbers active(grid.nodes);
    detail::Collector<D> found(batch);
    detail::for_each_element<D>(
        grid.lattice, detail::WithinVolume{grid.nodes.nodes() - Int3{1, 1, 1}},
        [&](const Element<D>& t) { return active.indicator(t.ref_node(), Field::values) != 0; },
        numbering,
        [&](const detail::NumberedElement<D>& leaf) {
            GridElement<D>& t = found.next();
            t.vertex = leaf.simplex.v;
            t.node = leaf.node;
            t.shape = detail::shape_of_any_kind(grid, leaf.simplex);
        });
    found.flush();
}

template <int D>
void ImplicitGrid<D>::interpolate(std::span<const double> active, std::span<double> all) const {
    parts_->workers.execute(
        [&] { detail::prolong<double>(parts_->lattice, parts_->nodes, active, all); });
}
template <int D>
void ImplicitGrid<D>::interpolate(std::span<const float> active, std::span<float> all) const {
    parts_->workers.execute(
        [&] { detail::prolong<float>(parts_->lattice, parts_->nodes, active, all); });
}

template class ImplicitGrid<1>;
template class ImplicitGrid<2>;
template class ImplicitGrid<3>;

}  // namespace isonest
