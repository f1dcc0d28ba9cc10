#include "query/traverse/bricks/surface_cubes.h"

#include <cmath>
#include <limits>

#include <isonest/value_type.h>

#include "query/view/morton.h"
#include "store/base/simd.h"

namespace isonest::detail {
namespace {

constexpr std::uint8_t kBelow = 1;
constexpr std::uint8_t kNotBelow = 2;
constexpr std::uint8_t kBoth = kBelow | kNotBelow;
constexpr std::uint8_t kAllTetrahedra = 0x3F;
constexpr Int3 kTwo{2, 2, 2};

/// Sides on which a chunk has values; none where it does not exist or has no finite value.
std::uint8_t sides_of_chunk(const ChunkSource& source, const ArrayInfo& array, const Int3& chunk,
                            double iso) {
    if (!array.has_chunk(chunk)) {
        return 0;
    }
    const ChunkRow row = source.row(array, chunk);
    return static_cast<std::uint8_t>((row.min < iso ? kBelow : 0) |
                                     (row.max >= iso ? kNotBelow : 0));
}

/// The smallest number of type T that is not below `iso`. REQUIRES: there is one.
template <class T>
T first_not_below(double iso) {
    if constexpr (std::is_integral_v<T>) {
        return static_cast<T>(std::ceil(iso));
    } else {
        const auto near = static_cast<T>(iso);
        return static_cast<double>(near) < iso
                   ? std::nextafter(near, std::numeric_limits<T>::infinity())
                   : near;
    }
}

template <class T>
[[gnu::always_inline]] inline void sides_of_row(const T* value, T limit,
                                                std::uint8_t* __restrict out, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        // NaN is on neither side.
        out[i] = static_cast<std::uint8_t>((value[i] < limit ? kBelow : 0) |
                                           (value[i] >= limit ? kNotBelow : 0));
    }
}

#define ISONEST_SIDES(tag, T)                                                                \
    ISONEST_SIMD void sides_of(const T* value, T limit, std::uint8_t* out, std::int64_t n) { \
        sides_of_row(value, limit, out, n);                                                  \
    }
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_SIDES)
#undef ISONEST_SIDES

ISONEST_SIMD void unite_rows(const std::uint8_t* row, std::uint8_t* __restrict into,
                             std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        into[i] |= row[i];
    }
}

/// The sides of a brick's nodes, plane by plane: its own K x K x K and the first ones of the chunks
/// after it.
template <class T>
class NodeSides {
  public:
    NodeSides(ChunkCache& cache, const Int3& brick, double iso)
        : array_(cache.source().layout().array(0, Field::values)),
          chunk_(cache.source().layout().header().chunk),
          limit_(first_not_below<T>(iso)) {
        for (std::size_t i = 0; i < 8; ++i) {
            const Int3 chunk = brick + kTwo.unlinear(static_cast<std::int64_t>(i));
            Piece& piece = pieces_[i];
            piece.sides = sides_of_chunk(cache.source(), array_, chunk, iso);
            if (piece.sides != 0) {
                piece.size = min(array_.chunk, array_.nodes - array_.first_node(chunk));
            }
            if (piece.sides == kBoth) {
                piece.values = cache.nodes(array_, chunk, static_cast<unsigned>(i));
            }
        }
    }
    [[nodiscard]] std::int64_t row_size() const { return chunk_ + 1; }
    /// Plane z (0 to K) as K + 1 rows; 0 where there is no node.
    void plane(std::int64_t z, std::vector<std::uint8_t>& out) const {
        out.assign(static_cast<std::size_t>(row_size() * row_size()), 0);
        for (std::size_t i = 0; i < 4; ++i) {
            const Piece& piece = pieces_[i + (z == chunk_ ? 4 : 0)];
            const std::int64_t at_z = z == chunk_ ? 0 : z;
            const bool next_x = (i & 1U) != 0;
            const bool next_y = (i & 2U) != 0;
            if (piece.sides == 0 || at_z >= piece.size.z) {
                continue;
            }
            const std::int64_t n = next_x ? 1 : piece.size.x;
            const std::int64_t rows = next_y ? 1 : piece.size.y;
            for (std::int64_t y = 0; y < rows; ++y) {
                std::uint8_t* const to =
                    out.data() + (next_y ? chunk_ : y) * row_size() + (next_x ? chunk_ : 0);
                if (piece.values.data == nullptr) {
                    std::fill_n(to, n, piece.sides);
                    continue;
                }
                const T* const from = reinterpret_cast<const T*>(piece.values.data.get()) +
                                      y * piece.values.stride.y + at_z * piece.values.stride.z;
                sides_of(from, limit_, to, n);
            }
        }
    }

  private:
    struct Piece {
        std::uint8_t sides = 0;
        Int3 size;
        ChunkNodes values;  ///< no data if all are on one side
    };
    const ArrayInfo& array_;
    std::int64_t chunk_;
    T limit_;
    std::array<Piece, 8> pieces_;
};

/// The side on which everything beyond the faces of a closed box is, of what reaches across it.
std::uint8_t side_beyond(const ClipBox& box, const Int3& low, std::int64_t size) {
    if (!box.close || overlap_of(box, low, low + Int3{size, size, size}) != Overlap::crossing) {
        return 0;
    }
    return *box.close == Outside::below ? kBelow : kNotBelow;
}

template <class T>
std::unique_ptr<MaskList> cubes_on_both_sides(ChunkCache& cache, const Int3& brick, double iso,
                                              const ClipBox& box) {
    const NodeSides<T> nodes(cache, brick, iso);
    const std::int64_t half = cache.source().layout().header().chunk / 2;
    const std::int64_t n = nodes.row_size();
    const Int3 base = brick * (2 * half);
    const std::uint8_t beyond = side_beyond(box, base, 2 * half);
    std::array<std::vector<std::uint8_t>, 3> planes;
    std::vector<std::uint8_t> line(static_cast<std::size_t>(n));
    std::unique_ptr<MaskList> masks;
    nodes.plane(0, planes[2]);
    for (std::int64_t z = 0; z < half; ++z) {
        std::swap(planes[0], planes[2]);
        nodes.plane(2 * z + 1, planes[1]);
        nodes.plane(2 * z + 2, planes[2]);
        for (std::int64_t y = 0; y < half; ++y) {
            std::fill(line.begin(), line.end(), std::uint8_t{0});
            for (const auto& plane : planes) {
                for (std::int64_t row = 2 * y; row <= 2 * y + 2; ++row) {
                    unite_rows(plane.data() + row * n, line.data(), n);
                }
            }
            for (std::int64_t x = 0; x < half; ++x) {
                const std::uint8_t* const at = line.data() + 2 * x;
                const auto sides = static_cast<std::uint8_t>(at[0] | at[1] | at[2]);
                if (sides != kBoth &&
                    ((sides | beyond) != kBoth ||
                     (sides | side_beyond(box, base + Int3{x, y, z} * 2, 2)) != kBoth)) {
                    continue;
                }
                if (masks == nullptr) {
                    masks =
                        std::make_unique<MaskList>(static_cast<std::size_t>(half * half * half));
                }
                (*masks)[morton_code({x, y, z})] = kAllTetrahedra;
            }
        }
    }
    return masks;
}

}  // namespace

bool may_hold_surface(const ChunkSource& source, const Int3& brick, double iso,
                      const ClipBox& box) {
    const ArrayInfo& array = source.layout().array(0, Field::values);
    const std::int64_t chunk = source.layout().header().chunk;
    std::uint8_t sides = side_beyond(box, brick * chunk, chunk);
    for (std::int64_t i = 0; i < 8 && sides != kBoth; ++i) {
        sides |= sides_of_chunk(source, array, brick + kTwo.unlinear(i), iso);
    }
    return sides == kBoth;
}

void add_chunks_on_both_sides(const ChunkSource& source, const Int3& brick, double iso,
                              const ClipBox& box, ChunkNeeds& needs) {
    if (!may_hold_surface(source, brick, iso, box)) {
        return;
    }
    const ArrayInfo& array = source.layout().array(0, Field::values);
    for (std::int64_t i = 0; i < 8; ++i) {
        const Int3 chunk = brick + kTwo.unlinear(i);
        if (sides_of_chunk(source, array, chunk, iso) == kBoth) {
            needs.add(array, chunk, i == 0);
        }
    }
}

std::unique_ptr<MaskList> surface_cubes(ChunkCache& cache, const Int3& brick, double iso,
                                        const ClipBox& box) {
    if (!may_hold_surface(cache.source(), brick, iso, box)) {
        return nullptr;
    }
    return dispatch(cache.source().layout().header().type, [&](auto tag) {
        return cubes_on_both_sides<typename decltype(tag)::type>(cache, brick, iso, box);
    });
}

}  // namespace isonest::detail
