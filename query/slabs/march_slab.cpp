// Source: W. Lorensen, H. Cline, "Marching cubes", SIGGRAPH 1987. Rows of cells without surface are
// skipped 64 cells at a time, by bits for the nodes below the isovalue.

#include "query/slabs/march_slab.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/value_type.h>

#include "query/march/cube_cases.h"
#include "query/march/march_hexahedron.h"
#include "query/slabs/slab_edges.h"
#include "query/slabs/slab_reader.h"
#include "query/slabs/slab_vertices.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr std::uint8_t kBelowBit = 1;
constexpr std::uint8_t kSpecialBit = 2;

template <class T>
ISONEST_SIMD void mark_sides(const T* value, T limit, std::uint8_t* __restrict out,
                             std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = value[i] < limit ? kBelowBit : 0;
    }
}

template <class T>
ISONEST_SIMD void mark_special(const T* value, T limit, T hit, std::uint8_t* __restrict out,
                               std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        const T v = value[i];
        bool special = v == hit;
        if constexpr (std::is_floating_point_v<T>) {
            special = special | !(std::fabs(v) <= std::numeric_limits<T>::max());
        }
        out[i] =
            static_cast<std::uint8_t>((v < limit ? kBelowBit : 0) | (special ? kSpecialBit : 0));
    }
}

/// Bit `bit` of each of eight bytes, packed into one byte.
std::uint64_t packed(std::uint64_t bytes, unsigned bit) {
    static_assert(std::endian::native == std::endian::little);
    constexpr std::uint64_t kLowest = 0x0101010101010101U;
    // moves the lowest bit of byte i to 56 + i
    constexpr std::uint64_t kToTop = 0x0102040810204080U;
    return ((bytes >> bit & kLowest) * kToTop) >> 56U;
}

/// Extends `n` ranges by `n` adjacent values.
template <class T>
ISONEST_SIMD void widen_ranges(const T* value, std::int64_t n, T* __restrict low,
                               T* __restrict high) {
    for (std::int64_t i = 0; i < n; ++i) {
        const T v = value[i];
        bool finite = true;
        if constexpr (std::is_floating_point_v<T>) {
            finite = std::fabs(v) <= std::numeric_limits<T>::max();
        }
        low[i] = finite && v < low[i] ? v : low[i];
        high[i] = finite && v > high[i] ? v : high[i];
    }
}

}  // namespace

template <class T>
bool NodeBits<T>::crosses(double iso) {
    return iso > static_cast<double>(std::numeric_limits<T>::lowest()) &&
           iso <= static_cast<double>(std::numeric_limits<T>::max());
}

template <class T>
NodeBits<T>::NodeBits(double iso) {
    if constexpr (std::is_integral_v<T>) {
        limit_ = static_cast<T>(std::ceil(iso));
        hit_ = limit_;
        special_ = static_cast<double>(limit_) == iso;
    } else {
        const auto near = static_cast<T>(iso);
        limit_ = static_cast<double>(near) < iso
                     ? std::nextafter(near, std::numeric_limits<T>::infinity())
                     : near;
        hit_ = static_cast<double>(limit_) == iso ? limit_ : std::numeric_limits<T>::quiet_NaN();
        special_ = true;
    }
}

template <class T>
bool NodeBits<T>::of_row(const T* row, std::int64_t nodes, std::uint64_t* below,
                         std::uint64_t* special) const {
    constexpr std::int64_t kWordsAtOnce = 8;
    std::array<std::uint8_t, 64 * kWordsAtOnce> marks{};
    std::uint64_t any = 0;
    for (std::int64_t at = 0; at < nodes; at += 64 * kWordsAtOnce) {
        const std::int64_t count = std::min(nodes - at, 64 * kWordsAtOnce);
        if (special_) {
            mark_special(row + at, limit_, hit_, marks.data(), count);
        } else {
            mark_sides(row + at, limit_, marks.data(), count);
        }
        const std::int64_t words = (count + 63) / 64;
        std::fill(marks.begin() + count, marks.begin() + 64 * words, std::uint8_t{0});
        for (std::int64_t w = 0; w < words; ++w) {
            std::uint64_t below_word = 0;
            std::uint64_t special_word = 0;
            for (unsigned byte = 0; byte < 8; ++byte) {
                std::uint64_t eight = 0;
                std::memcpy(&eight, marks.data() + 64 * w + 8 * byte, sizeof(eight));
                below_word |= packed(eight, 0) << (8 * byte);
                special_word |= packed(eight, 1) << (8 * byte);
            }
            below[at / 64 + w] = below_word;
            special[at / 64 + w] = special_word;
            any |= special_word;
        }
    }
    return any != 0;
}

template <class T>
void widen_range(const T* values, std::int64_t count, double& low, double& high) {
    constexpr std::int64_t kAtOnce = 256;
    std::array<T, kAtOnce> least;
    std::array<T, kAtOnce> most;
    least.fill(std::numeric_limits<T>::max());
    most.fill(std::numeric_limits<T>::lowest());
    for (std::int64_t at = 0; at < count; at += kAtOnce) {
        widen_ranges(values + at, std::min(count - at, kAtOnce), least.data(), most.data());
    }
    const T smallest = *std::min_element(least.begin(), least.end());
    const T largest = *std::max_element(most.begin(), most.end());
    if (smallest <= largest) {
        low = std::min(low, static_cast<double>(smallest));
        high = std::max(high, static_cast<double>(largest));
    }
}

#define ISONEST_INSTANTIATE(tag, T) \
    template class NodeBits<T>;     \
    template void widen_range<T>(const T*, std::int64_t, double&, double&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE

namespace {

using Words = std::vector<std::uint64_t>;

/// The bits of a plane's nodes, row by row.
struct PlaneBits {
    Words below;
    Words special;
    std::vector<std::uint8_t> row_special;  ///< whether a row has special nodes
};

/// Four rows of bits around a row of cells.
class CellBits {
  public:
    CellBits(std::array<const std::uint64_t*, 4> rows, std::size_t words)
        : rows_(rows), words_(words) {}

    /// For cells 64 w, ...: whether corners are on both sides; bits behind the row are undefined.
    [[nodiscard]] std::uint64_t crossed(std::size_t w) const {
        std::uint64_t any = 0;
        std::uint64_t all = ~std::uint64_t{0};
        for (const std::uint64_t* const row : rows_) {
            const std::uint64_t low = row[w];
            const std::uint64_t high = next(row, w);
            any |= low | high;
            all &= low & high;
        }
        return any & ~all;
    }
    /// For cells 64 w, ...: whether the bit of any corner is set.
    [[nodiscard]] std::uint64_t any(std::size_t w) const {
        std::uint64_t any = 0;
        for (const std::uint64_t* const row : rows_) {
            any |= row[w] | next(row, w);
        }
        return any;
    }
    /// The bits of a cell's corners.
    [[nodiscard]] unsigned corners(std::size_t w, unsigned bit) const {
        unsigned corners = 0;
        for (unsigned i = 0; i < 4; ++i) {
            const std::uint64_t low = rows_[i][w] >> bit & 1U;
            const std::uint64_t high = next(rows_[i], w) >> bit & 1U;
            corners |= static_cast<unsigned>(low | high << 1U) << (2 * i);
        }
        return corners;
    }

  private:
    [[nodiscard]] std::uint64_t next(const std::uint64_t* row, std::size_t w) const {
        return row[w] >> 1U | (w + 1 < words_ ? row[w + 1] << 63U : 0);
    }
    std::array<const std::uint64_t*, 4> rows_;
    std::size_t words_;
};

template <class T>
class SlabMarch : public SlabMarcher {
  public:
    SlabMarch(const Int3& nodes, const SlabPlace& place)
        : values_{nullptr, 0, nodes},
          place_(place),
          bits_of_(place.iso),
          words_(words_of(nodes.x)),
          vertices_(nodes, place, slab_) {
        const auto rows = static_cast<std::size_t>(nodes.y);
        for (PlaneBits& plane : planes_) {
            plane.below.resize(rows * words_);
            plane.special.resize(rows * words_);
            plane.row_special.resize(rows);
        }
    }

    MarchedSlab march(const SlabPlanes& planes, const Slab& layers,
                      const SlabEstimate& likely) override {
        slab_ = {};
        slab_.positions.reserve(likely.vertices);
        slab_.normals.reserve(place_.normals ? likely.vertices : 0);
        slab_.triangles.reserve(likely.triangles);
        begin(planes);
        vertices_.begin(values_);
        march_layers(
            layers, [](std::int64_t /*y*/, std::int64_t /*z*/) {},
            [&](std::int64_t z) {
                if (z == layers.begin) {
                    vertices_.keep_plane(0);
                }
            });
        vertices_.keep_plane(1);
        vertices_.finish(layers);
        return std::move(slab_);
    }
    void march_parts(const SlabPlanes& planes, const Slab& layers, std::size_t most,
                     const std::function<void(std::uint64_t, MarchedSlab&&)>& part) override {
        slab_ = {};
        begin(planes);
        vertices_.begin(values_);
        vertices_.begin_part(0, layers.begin);
        const std::int64_t rows = values_.nodes.y - 1;
        const auto end_part = [&](std::int64_t y, std::int64_t z) {
            vertices_.finish_part(y);
            if (!slab_.triangles.empty() || !slab_.shared.empty()) {
                part(static_cast<std::uint64_t>(z * rows + y), std::move(slab_));
            }
            slab_ = {};
        };
        march_layers(
            layers,
            [&](std::int64_t y, std::int64_t z) {
                if (vertices_.weight() >= most) {
                    end_part(y, z);
                    vertices_.begin_part((y + 1) % rows, y + 1 < rows ? z : z + 1);
                }
            },
            [](std::int64_t /*z*/) {});
        end_part(rows - 1, layers.end - 1);
    }

  private:
    void begin(const SlabPlanes& planes) {
        values_.data = reinterpret_cast<const T*>(planes.data);
        values_.first = planes.first;
    }
    /// Calls row(y, z) after each row of cells and layer(z) after each layer.
    template <class Row, class Layer>
    void march_layers(const Slab& layers, const Row& row, const Layer& layer) {
        find_sides(layers.begin);
        for (std::int64_t z = layers.begin; z < layers.end; ++z) {
            std::swap(planes_[0], planes_[1]);
            find_sides(z + 1);
            vertices_.begin_layer(z);
            for (std::int64_t y = 0; y + 1 < values_.nodes.y; ++y) {
                march_row(y, z);
                row(y, z);
            }
            layer(z);
        }
    }
    /// Computes the bits of a plane's nodes, as the upper plane.
    void find_sides(std::int64_t z) {
        PlaneBits& plane = planes_[1];
        for (std::int64_t y = 0; y < values_.nodes.y; ++y) {
            const auto row = static_cast<std::size_t>(y);
            plane.row_special[row] = bits_of_.of_row(values_.at({0, y, z}), values_.nodes.x,
                                                     plane.below.data() + row * words_,
                                                     plane.special.data() + row * words_)
                                         ? 1
                                         : 0;
        }
    }
    [[nodiscard]] CellBits cells_of(std::int64_t y, Words PlaneBits::*bits) const {
        const std::size_t row = static_cast<std::size_t>(y) * words_;
        return {{(planes_[0].*bits).data() + row, (planes_[0].*bits).data() + row + words_,
                 (planes_[1].*bits).data() + row, (planes_[1].*bits).data() + row + words_},
                words_};
    }
    [[nodiscard]] bool has_special(std::int64_t y) const {
        const auto row = static_cast<std::size_t>(y);
        return (planes_[0].row_special[row] | planes_[0].row_special[row + 1] |
                planes_[1].row_special[row] | planes_[1].row_special[row + 1]) != 0;
    }
    void march_row(std::int64_t y, std::int64_t z) {
        const CellBits below = cells_of(y, &PlaneBits::below);
        const CellBits special = cells_of(y, &PlaneBits::special);
        const bool has_special = this->has_special(y);
        const auto cells = static_cast<std::size_t>(values_.nodes.x - 1);
        bool is_begun = false;
        for (std::size_t w = 0; 64 * w < cells; ++w) {
            std::uint64_t crossed = below.crossed(w);
            if (cells - 64 * w < 64) {
                crossed &= (std::uint64_t{1} << (cells - 64 * w)) - 1;
            }
            if (crossed == 0) {
                continue;
            }
            if (!std::exchange(is_begun, true)) {
                vertices_.begin_row(y);
            }
            const std::uint64_t specials = has_special ? special.any(w) : 0;
            for (; crossed != 0; crossed &= crossed - 1) {
                const auto bit = static_cast<unsigned>(std::countr_zero(crossed));
                const auto x = static_cast<std::int64_t>(64 * w + bit);
                if ((specials >> bit & 1U) != 0) {
                    march_special({x, y, z}, below.corners(w, bit));
                } else {
                    march_plain(x, below.corners(w, bit));
                }
            }
        }
    }
    /// Marches a cell without corners on the surface.
    void march_plain(std::int64_t x, unsigned below) {
        const HexahedronCase& c = cases_[below];
        std::array<std::uint32_t, 12> v{};
        for (std::size_t i = 0; i < c.edges; ++i) {
            v[i] = vertices_.on_edge(x, c.edge[i]);
        }
        for (std::size_t i = 0; i < c.triangles; ++i) {
            const auto& t = c.triangle[i];
            slab_.triangles.push_back({v[t[0]], v[t[1]], v[t[2]]});
        }
        ++slab_.cells;
    }
    /// Marches a cell with corners on the surface; one with missing corners has no surface.
    void march_special(const Int3& low, unsigned below) {
        Cube cube{low, 0, below, {}};
        for (unsigned i = 0; i < 8; ++i) {
            cube.value[i] = vertices_.value(low.x, i);
            if (!std::isfinite(cube.value[i])) {
                return;
            }
        }
        vertices_.forget_positions();
        const HexahedronCase& c = cases_[below];
        for (std::size_t i = 0; i < c.polygons; ++i) {
            PolygonWithHits polygon(vertices_, cube, place_.iso, c, i);
            if (polygon.has_hits()) {
                collected_.clear();
                polygon.march(false, collected_);
                for (const CollectedTriangle& t : collected_) {
                    slab_.triangles.push_back(t.v);
                }
                continue;
            }
            for (std::size_t t = c.first[i] - 2 * i; t < c.first[i + 1] - 2 * (i + 1); ++t) {
                const auto corner = [&](std::size_t k) {
                    return vertices_.on_edge(low.x, c.edge[c.triangle[t][k]]);
                };
                slab_.triangles.push_back({corner(0), corner(1), corner(2)});
            }
        }
        ++slab_.cells;
    }

    SlabValues<T> values_;
    SlabPlace place_;
    NodeBits<T> bits_of_;
    std::size_t words_;
    const HexahedronCases& cases_ = hexahedron_cases();
    MarchedSlab slab_;
    SlabVertices<T> vertices_;
    std::array<PlaneBits, 2> planes_;  ///< below and above the cells
    std::vector<CollectedTriangle> collected_;
};

}  // namespace

std::unique_ptr<SlabMarcher> make_slab_marcher(ValueType type, const Int3& nodes,
                                               const SlabPlace& place) {
    return dispatch(type, [&](auto tag) -> std::unique_ptr<SlabMarcher> {
        using T = typename decltype(tag)::type;
        return NodeBits<T>::crosses(place.iso) ? std::make_unique<SlabMarch<T>>(nodes, place)
                                               : nullptr;
    });
}

std::uint64_t march_slab_bytes(const Int3& nodes) {
    // Edges, and bits: two for every node of each plane.
    return SlabEdges::bytes(nodes) +
           4 * sizeof(std::uint64_t) * words_of(nodes.x) * static_cast<std::uint64_t>(nodes.y);
}

}  // namespace isonest::detail
