#include "preprocess/levels/write_positions.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <numeric>
#include <span>
#include <vector>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "preprocess/levels/level_sink.h"
#include "preprocess/sources/wrapping/plane_window.h"
#include "store/base/in_order.h"
#include "store/base/vectors.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

/// Corners of cells whose determinants have the same sign.
struct CellSigns {
    std::uint64_t cells = 0;      ///< cells of which it is true for all corners
    std::int64_t first_not = -1;  ///< the first cell of which it is not, by its low node; -1: none

    void add(bool is_of_all, std::int64_t node) {
        cells += is_of_all ? 1 : 0;
        if (!is_of_all && (first_not < 0 || node < first_not)) {
            first_not = node;
        }
    }
    void add(const CellSigns& other) {
        cells += other.cells;
        if (other.first_not >= 0 && (first_not < 0 || other.first_not < first_not)) {
            first_not = other.first_not;
        }
    }
};

/// A chunk of each coordinate, and what is known of its nodes and of the cells that begin at them.
struct PositionChunks {
    std::array<EncodedChunk, 3> coordinates;
    std::uint64_t cells = 0;
    CellSigns positive;
    CellSigns negative;
    std::array<double, 3> lengths{};  ///< sums over the edges that begin here, by axis
    std::array<std::uint64_t, 3> edges{};
};

class PositionPass {
  public:
    PositionPass(std::span<PlaneWindow> windows, const NodePositions& positions,
                 const StoreLayout& layout)
        : windows_(windows), layout_(layout), nodes_(layout.header().nodes) {
        for (std::size_t a = 0; a < 3; ++a) {
            const VolumeDescription of = positions.coordinates.at(a)->describe();
            types_.at(a) = of.type;
            names_.at(a) = of.name;
        }
    }

    /// REQUIRES: the windows have the chunk's planes and the one after them.
    template <class T>
    PositionChunks chunk(const Int3& c) const {
        const ArrayInfo& array = layout_.positions()[0];
        const Int3 low = array.first_node(c);
        const Int3 own = min(array.chunk, nodes_ - low);
        const Int3 with_next = min(array.chunk + Int3{1, 1, 1}, nodes_ - low);
        PositionChunks out;
        std::array<std::vector<T>, 3> at;
        for (std::size_t a = 0; a < 3; ++a) {
            at.at(a) = box<T>(a, low, with_next);
            encode<T>(a, c, own, with_next, at.at(a), out.coordinates.at(a));
        }
        const auto place = [&](const Int3& p) {
            const auto i = static_cast<std::size_t>(with_next.linear(p));
            return Double3{static_cast<double>(at[0][i]), static_cast<double>(at[1][i]),
                           static_cast<double>(at[2][i])};
        };
        for (std::int64_t i = 0; i < own.product(); ++i) {
            look_at(own.unlinear(i), low, with_next, place, out);
        }
        return out;
    }

  private:
    /// The coordinate of the nodes in a box, x fastest.
    template <class T>
    std::vector<T> box(std::size_t axis, const Int3& low, const Int3& size) const {
        std::vector<T> numbers(static_cast<std::size_t>(size.product()));
        for (std::int64_t row = 0; row < size.y * size.z; ++row) {
            const std::byte* const from =
                windows_[axis].row(low.y + row % size.y, low.z + row / size.y);
            dispatch(types_.at(axis), [&](auto tag) {
                using Given = typename decltype(tag)::type;
                const Given* const given = reinterpret_cast<const Given*>(from) + low.x;
                std::transform(given, given + size.x, numbers.begin() + row * size.x,
                               [](Given x) { return static_cast<T>(x); });
            });
        }
        return numbers;
    }

    template <class T>
    void encode(std::size_t axis, const Int3& c, const Int3& own, const Int3& with_next,
                const std::vector<T>& numbers, EncodedChunk& out) const {
        const ArrayInfo& array = layout_.positions()[axis];
        out.array = &array;
        out.chunk = c;
        out.row.min = std::numeric_limits<double>::infinity();
        out.row.max = -out.row.min;
        std::vector<T> elements(static_cast<std::size_t>(array.chunk.product()), T{0});
        for (std::int64_t i = 0; i < own.product(); ++i) {
            const Int3 p = own.unlinear(i);
            const T x = numbers[static_cast<std::size_t>(with_next.linear(p))];
            const auto number = static_cast<double>(x);
            if (!(std::fabs(number) <= kMaxPosition)) {
                const Int3 node = array.first_node(c) + p;
                throw Error(ErrorKind::invalid_argument, {names_.at(axis)},
                            fmt::format("the {} coordinate of node {} {} {} is {}: the nodes of a "
                                        "curvilinear grid need positions between {:g} and {:g}",
                                        "xyz"[axis], node.x, node.y, node.z, number, -kMaxPosition,
                                        kMaxPosition));
            }
            elements[static_cast<std::size_t>(array.chunk.linear(p))] = x;
            out.row.min = std::min(out.row.min, number);
            out.row.max = std::max(out.row.max, number);
        }
        out.encode(std::as_bytes(std::span(elements)));
    }

    /// Adds the edges and the cell that begin at node `low` + p.
    template <class Place>
    void look_at(const Int3& p, const Int3& low, const Int3& size, const Place& place,
                 PositionChunks& out) const {
        const Double3 here = place(p);
        bool is_cell = true;
        for (int axis = 0; axis < 3; ++axis) {
            Int3 next = p;
            ++next[axis];
            if (next[axis] >= size[axis]) {
                is_cell = false;
                continue;
            }
            const Double3 there = place(next);
            const auto a = static_cast<std::size_t>(axis);
            out.lengths.at(a) += hypot3(there[0] - here[0], there[1] - here[1], there[2] - here[2]);
            ++out.edges.at(a);
        }
        if (!is_cell) {
            return;
        }
        std::array<Double3, 8> corner{};
        for (unsigned i = 0; i < 8; ++i) {
            corner.at(i) = place(p + Int3{i & 1U, i >> 1U & 1U, i >> 2U});
        }
        bool all_positive = true;
        bool all_negative = true;
        for (unsigned i = 0; i < 8; ++i) {
            std::array<Double3, 3> along{};
            for (unsigned axis = 0; axis < 3; ++axis) {
                const Double3& from = corner.at(i & ~(1U << axis));
                const Double3& to = corner.at(i | 1U << axis);
                along.at(axis) = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
            }
            const double determinant = dot(cross(along[0], along[1]), along[2]);
            all_positive = all_positive && determinant > 0;
            all_negative = all_negative && determinant < 0;
        }
        const std::int64_t node = nodes_.linear(low + p);
        ++out.cells;
        out.positive.add(all_positive, node);
        out.negative.add(all_negative, node);
    }

    std::span<PlaneWindow> windows_;
    const StoreLayout& layout_;
    Int3 nodes_;
    std::array<ValueType, 3> types_{};
    std::array<std::string, 3> names_;
};

/// Sums up the chunks in their order.
class PositionSum {
  public:
    void add(const PositionChunks& chunk) {
        for (std::size_t a = 0; a < 3; ++a) {
            low_.at(a) = std::min(low_.at(a), chunk.coordinates.at(a).row.min);
            high_.at(a) = std::max(high_.at(a), chunk.coordinates.at(a).row.max);
            lengths_.at(a) += chunk.lengths.at(a);
            edges_.at(a) += chunk.edges.at(a);
        }
        cells_ += chunk.cells;
        positive_.add(chunk.positive);
        negative_.add(chunk.negative);
    }
    /// `name`: of the volume.
    [[nodiscard]] CurvedNodes whole(ValueType type, const Int3& nodes,
                                    const std::string& name) const {
        CurvedNodes whole;
        whole.type = type;
        whole.low = low_;
        whole.high = high_;
        for (std::size_t a = 0; a < 3; ++a) {
            whole.step.at(a) = lengths_.at(a) / static_cast<double>(edges_.at(a));
            if (!(whole.step.at(a) > 0)) {
                throw Error(ErrorKind::invalid_argument, {name},
                            fmt::format("along axis {} of the lattice, all nodes of the "
                                        "curvilinear grid lie in one place",
                                        a));
            }
        }
        whole.mirrored = negative_.cells > positive_.cells;
        const CellSigns& most = whole.mirrored ? negative_ : positive_;
        whole.folded = cells_ - most.cells;
        whole.first_folded = most.first_not < 0 ? Int3{} : nodes.unlinear(most.first_not);
        return whole;
    }

  private:
    static constexpr double kInfinity = std::numeric_limits<double>::infinity();
    Double3 low_{kInfinity, kInfinity, kInfinity};
    Double3 high_{-kInfinity, -kInfinity, -kInfinity};
    std::array<double, 3> lengths_{};
    std::array<std::uint64_t, 3> edges_{};
    std::uint64_t cells_ = 0;
    CellSigns positive_;
    CellSigns negative_;
};

/// Heap of a chunk under way: its three coordinates with the next nodes, one chunk raw, three
/// encoded.
std::uint64_t heap_of_chunk(const StoreLayout& layout) {
    const ArrayInfo& array = layout.positions()[0];
    const Int3 with_next = array.chunk + Int3{1, 1, 1};
    return 3 * static_cast<std::uint64_t>(with_next.product()) * array.codec.element_size +
           4 * array.chunk_bytes() + codec_heap(array.chunk_bytes(), layout.header().compression);
}

std::uint64_t heap_of_sources(const NodePositions& positions) {
    const auto& all = positions.coordinates;
    return std::accumulate(all.begin(), all.end(), std::uint64_t{0},
                           [](std::uint64_t sum, const auto& of) { return sum + of->heap(); });
}

/// The least memory for the windows over the three sources.
constexpr std::uint64_t kMinWindows = 6U << 20U;

}  // namespace

std::uint64_t position_heap(const NodePositions& positions, const StoreLayout& layout) {
    return heap_of_sources(positions) + heap_of_chunk(layout) + kMinWindows;
}

CurvedNodes write_positions(const NodePositions& positions, StoreWriter& writer,
                            std::uint64_t memory, int tokens,
                            const std::filesystem::path& scratch_folder, Progress& progress) {
    const StoreLayout& layout = writer.layout();
    const ArrayInfo& array = layout.positions()[0];
    const std::uint64_t each = heap_of_chunk(layout);
    std::uint64_t left = memory - std::min(memory, heap_of_sources(positions));
    const auto most = static_cast<std::uint64_t>(tokens);
    const std::uint64_t under_way = std::clamp<std::uint64_t>(left * 3 / 5 / each, 1, most);
    left -= std::min(left, under_way * each);
    std::vector<PlaneWindow> windows;
    windows.reserve(3);
    for (const auto& source : positions.coordinates) {
        windows.emplace_back(*source, array.chunk.z + 1, left / 3, scratch_folder, progress);
    }
    const PositionPass pass(windows, positions, layout);
    PositionSum sum;
    progress.begin("positions", static_cast<std::uint64_t>(array.grid.product()), "chunks");
    for (std::int64_t z = 0; z < array.grid.z; ++z) {
        const std::int64_t begin = z * array.chunk.z;
        for (PlaneWindow& window : windows) {
            window.load(begin, std::min(begin + array.chunk.z + 1, array.nodes.z));
        }
        in_order(
            array.grid.x * array.grid.y, static_cast<int>(under_way),
            [&](std::int64_t i) {
                progress.check();
                const Int3 c{i % array.grid.x, i / array.grid.x, z};
                return dispatch(layout.header().curved->type, [&](auto tag) {
                    using T = typename decltype(tag)::type;
                    return pass.chunk<T>(c);
                });
            },
            [&](std::int64_t /*i*/, PositionChunks& chunk) {
                sum.add(chunk);
                for (EncodedChunk& encoded : chunk.coordinates) {
                    writer.write_chunk(*encoded.array, encoded.chunk, encoded.bytes, encoded.row);
                    encoded.bytes = {};
                }
                progress.advance(1);
            });
    }
    const CurvedNodes whole = sum.whole(layout.header().curved->type, array.nodes,
                                        positions.coordinates[0]->describe().name);
    writer.set_curved(whole);
    return whole;
}

}  // namespace isonest::detail
