#include "query/traverse/bricks/finest_brick.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <isonest/value_type.h>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/bricks/brick_tests.h"
#include "query/values/blocks.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr int kLevel = 3;
constexpr std::int64_t kEdge = std::int64_t{1} << kLevel;

/// Values and bounds of the cubes in one brick of level 3.
class CoarseCubes {
  public:
    CoarseCubes(TraversalRun& run, const Int3& brick)
        : culling_(*run.query.culling),
          at_(run.layout(), kLevel, brick),
          values_(run.cache, kLevel, at_.base),
          bound_(field_view(run, culling_.field(), at_)),
          counts_(run.counts.local()) {}

    /// Whether the six tetrahedra of the cube themselves face away.
    [[nodiscard]] bool face_away(const Int3& cube) { return all_face_away(cube, 0); }
    /// Whether all their descendants face away.
    [[nodiscard]] bool all_below_face_away(const Int3& cube) {
        return all_face_away(cube, bound_.centre(cube));
    }

  private:
    [[nodiscard]] bool all_face_away(const Int3& cube, double beta) {
        CubeNodes nodes;
        values_.load(nodes, {cube.x / 2, cube.y / 2, cube.z / 2});
        const auto& tetrahedra = topology().subcube[mirror_of(cube) ^ nodes.mirror];
        return std::all_of(tetrahedra.begin(), tetrahedra.end(), [&](const auto& t) {
            ++counts_.visited;
            return culling_.faces_away(nodes.value, t, nodes.mirror, at_.stride, beta);
        });
    }

    const Culling& culling_;
    BrickPlace at_;
    CubeLoader values_;
    FieldView bound_;
    TraversalCounts& counts_;
};

/// The brick's cubes of level 3 that may contain surface.
std::vector<Int3> surface_cubes_of(const TraversalRun& run, const Int3& brick) {
    const StoreLayout& layout = run.layout();
    const std::int64_t edge = layout.header().chunk / kEdge;
    const Int3 first = brick * edge;
    const Int3 size = min(Int3{edge, edge, edge}, layout.lattice().cells_at(kLevel) - first);
    std::vector<Int3> cubes;
    for (std::int64_t i = 0; i < size.product(); ++i) {
        const Int3 cube = first + size.unlinear(i);
        const auto range = layout.has_cube_ranges(kLevel)
                               ? run.cache.source().cube_range(kLevel, cube)
                               : std::nullopt;
        if (!range || range->may_hold(run.query.iso)) {
            cubes.push_back(cube);
        }
    }
    return cubes;
}

}  // namespace

bool may_face_viewer(TraversalRun& run, const Int3& brick) {
    if (run.layout().lattice().top() < kLevel) {
        return true;
    }
    const std::vector<Int3> surface = surface_cubes_of(run, brick);
    CoarseCubes cubes(run, {brick.x / kEdge, brick.y / kEdge, brick.z / kEdge});
    return !std::all_of(surface.begin(), surface.end(),
                        [&](const Int3& cube) { return cubes.face_away(cube); }) ||
           !std::all_of(surface.begin(), surface.end(),
                        [&](const Int3& cube) { return cubes.all_below_face_away(cube); });
}

void add_facing_needs(const TraversalRun& run, const Int3& brick, ChunkNeeds& needs) {
    const StoreLayout& layout = run.layout();
    if (layout.lattice().top() < kLevel) {
        return;
    }
    const std::int64_t chunk = layout.header().chunk;
    const std::int64_t edge = chunk / kEdge;
    const Int3 first = brick * edge;
    const ArrayInfo& values = layout.array(kLevel, Field::values);
    const ArrayInfo& bounds = layout.array(kLevel, run.query.culling->field());
    // A cube is in a parent with even coordinates, whose nodes are needed.
    const Int3 end = first + Int3{edge, edge, edge};
    const Int3 last = min({end.x + end.x % 2, end.y + end.y % 2, end.z + end.z % 2},
                          values.nodes - Int3{1, 1, 1});
    const Int3 low = values.chunk_of(first);
    const Int3 size = values.chunk_of(last) - low + Int3{1, 1, 1};
    for (std::int64_t i = 0; i < size.product(); ++i) {
        needs.add(values, low + size.unlinear(i), i == 0);
    }
    needs.add(bounds, bounds.chunk_of(first));
}

namespace {

/// `cut`: the element extends across the box; at a closed box the outside is included.
Sides sides_at(const Sides& sides, bool cut, const std::optional<Outside>& close) {
    return cut && close ? sides.with(*close) : sides;
}

/// The tetrahedra of one subcube, one by one.
class ByTetrahedra {
  public:
    /// The axes along which the topology tables are mirrored in a cube of level 1.
    static unsigned mirror(const Int3& parent) { return mirror_of(parent); }

    ByTetrahedra(TraversalRun& run, LocalMesh& mesh)
        : culling_(run.query.culling ? &*run.query.culling : nullptr),
          close_(run.query.box.close),
          counts_(run.counts.local()),
          action_(run, mesh, 0, run.query.iso) {}

    static void prepare(CubeNodes& /*nodes*/) {}
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask, bool cut) {
        const auto& tetrahedra = topology().subcube[corner];
        if (!sides_at(nodes.sides, cut, close_).both_in(nodes_of(tetrahedra, mask))) {
            return;
        }
        for (unsigned order = 0; order < 6; ++order) {
            if ((mask >> order & 1U) != 0) {
                ++counts_.visited;
                march(nodes, tetrahedra[order], cut);
            }
        }
    }
    /// Marches the tetrahedron if the surface passes through it and it is not culled.
    void march(const CubeNodes& nodes, const TopologyTetrahedron& t, bool cut) {
        if (!sides_at(nodes.sides, cut, close_).both_in(t)) {
            return;
        }
        const auto corners = complete_corners(nodes, nodes.value, t);
        if (corners && !faces_away(nodes, t)) {
            action_(*corners, t.positive != is_mirror_image(nodes.mirror), 0, cut);
        }
    }

  private:
    [[nodiscard]] bool faces_away(const CubeNodes& nodes, const TopologyTetrahedron& t) const {
        return culling_ != nullptr && culling_->faces_away(nodes.value, t, nodes.mirror, 1, 0);
    }

    const Culling* culling_;
    std::optional<Outside> close_;
    TraversalCounts& counts_;
    LeafMarch action_;
};

/// All tetrahedra of a subcube at once. REQUIRES: neither culling nor on_leaf.
class ByCubes {
  public:
    static unsigned mirror(const Int3& parent) { return mirror_of(parent); }

    ByCubes(TraversalRun& run, LocalMesh& mesh)
        : iso_(run.query.iso),
          is_closed_(run.query.box.close.has_value()),
          mesh_(mesh),
          counts_(run.counts.local()),
          single_(run, mesh) {}

    void prepare(CubeNodes& nodes) const { nodes.special = special_nodes(nodes.value, iso_); }
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask, bool cut) {
        if (cut && is_closed_) {
            return single_.subcube(nodes, corner, mask, cut);
        }
        counts_.visited += static_cast<std::uint64_t>(std::popcount(mask));
        Cube cube{nodes.subcube(corner), nodes.mirror ^ corner, 0, {}};
        for (unsigned i = 0; i < 8; ++i) {
            // Seen from the subcube's all-even corner, which is that of the parent.
            const unsigned at = interest::kCorners[corner][i ^ corner];
            cube.value[i] = nodes.value[at];
            cube.below |= ((nodes.sides.below >> at) & 1U) << i;
        }
        if ((nodes.special & topology_.corners[corner]) == 0) {
            counts_.leaves += mesh_.march_cube(cube, iso_, cut);
            return;
        }
        for (std::size_t order = 0; order < 6; ++order) {
            const TopologyTetrahedron& t = topology_.subcube[corner][order];
            if ((nodes.special & t.nodes) == 0) {
                counts_.leaves += mesh_.march_in_cube(cube, order, iso_, cut);
            } else if ((mask >> order & 1U) != 0) {
                single_.march(nodes, t, cut);
            }
        }
    }

  private:
    double iso_;
    bool is_closed_;
    const Topology& topology_ = topology();
    LocalMesh& mesh_;
    TraversalCounts& counts_;
    ByTetrahedra single_;
};

/// A subcube as one hexahedral cell. REQUIRES: neither culling nor on_leaf.
class ByHexahedra {
  public:
    static unsigned mirror(const Int3& /*parent*/) { return 0; }

    ByHexahedra(TraversalRun& run, LocalMesh& mesh)
        : iso_(run.query.iso),
          close_(run.query.box.close),
          mesh_(mesh),
          counts_(run.counts.local()) {}

    void prepare(CubeNodes& nodes) const { nodes.special = special_nodes(nodes.value, iso_); }
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t /*mask*/, bool cut) {
        const std::uint32_t corners = topology_.corners[corner];
        if (!sides_at(nodes.sides, cut, close_).both_in(corners)) {
            return;
        }
        ++counts_.visited;
        const bool special = (nodes.special & corners) != 0;
        Cube cube{nodes.subcube(corner), 0, 0, {}};
        bool missing = false;
        for (unsigned i = 0; i < 8; ++i) {
            const unsigned at = interest::kCorners[corner][i];
            cube.value[i] = nodes.value[at];
            cube.below |= ((nodes.sides.below >> at) & 1U) << i;
            missing = missing || (special && !std::isfinite(cube.value[i]));
        }
        if (!missing) {
            counts_.leaves += mesh_.march_hexahedron(cube, special, iso_, cut) ? 1 : 0;
        }
    }

  private:
    double iso_;
    std::optional<Outside> close_;
    const Topology& topology_ = topology();
    LocalMesh& mesh_;
    TraversalCounts& counts_;
};

/// Elements: one of the above classes.
template <class Elements>
class FinestBrick {
  public:
    FinestBrick(TraversalRun& run, const Int3& brick)
        : query_(run.query),
          base_(brick * run.layout().header().chunk),
          values_(run.cache, 0, base_),
          parts_(run, 0, base_),
          elements_(run, parts_.mesh()) {}

    void march(const MaskList& cubes) {
        parts_.for_each_parent(cubes, 0, [&](const Int3& parent, std::uint8_t mask) {
            const Overlap overlap =
                overlap_of(query_.box, parent * 2, (parent + Int3{1, 1, 1}) * 2);
            if (overlap != Overlap::outside) {
                refine(parent, mask, overlap == Overlap::crossing);
            }
        });
    }

  private:
    /// Processes everything below a cube of level 1, without the tetrahedra in between.
    void refine(const Int3& parent, std::uint8_t mask, bool cut) {
        CubeNodes nodes;
        values_.load(nodes, parent, Elements::mirror(parent));
        nodes.cut = cut;
        nodes.sides = sides_of(nodes.value, query_.iso);
        const Sides sides = sides_at(nodes.sides, cut, query_.box.close);
        if (!sides.both_in(nodes_of(topology_.cube, mask))) {
            return;
        }
        elements_.prepare(nodes);
        std::array<std::uint8_t, 8> below{};
        for (unsigned order = 0; order < 6; ++order) {
            if ((mask >> order & 1U) != 0 && sides.both_in(topology_.cube[order])) {
                for (unsigned corner = 0; corner < 8; ++corner) {
                    below[corner] |= topology_.below_cube[order][corner];
                }
            }
        }
        for (unsigned corner = 0; corner < 8; ++corner) {
            if (below[corner] != 0 && sides.both_in(topology_.corners[corner])) {
                subcube(nodes, corner, below[corner]);
            }
        }
    }
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask) {
        bool cut = nodes.cut;
        if (cut) {
            const Int3 cube = nodes.subcube(corner);
            const Overlap overlap = overlap_of(query_.box, cube, cube + Int3{1, 1, 1});
            if (overlap == Overlap::outside) {
                return;
            }
            cut = overlap == Overlap::crossing;
        }
        elements_.subcube(nodes, corner, mask, cut);
    }

    const TraversalQuery& query_;
    Int3 base_;
    const Topology& topology_ = topology();
    CubeLoader values_;
    BrickParts parts_;
    Elements elements_;
};

}  // namespace

void march_finest_brick(TraversalRun& run, const Int3& brick, const MaskList& cubes) {
    if (run.query.cells == Cells::hexahedra) {
        FinestBrick<ByHexahedra>(run, brick).march(cubes);
    } else if (run.query.culling || run.query.on_leaf) {
        FinestBrick<ByTetrahedra>(run, brick).march(cubes);
    } else {
        FinestBrick<ByCubes>(run, brick).march(cubes);
    }
}

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

/// The sides of a brick's nodes, plane by plane: its own K x K x K and the first ones of the next
/// chunks.
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
        ChunkNodes values;  ///< no data if all are on the same side
    };
    const ArrayInfo& array_;
    std::int64_t chunk_;
    T limit_;
    std::array<Piece, 8> pieces_;
};

/// The side of everything beyond the faces of a closed box, for a block that extends across it.
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
