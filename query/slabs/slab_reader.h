// Slabs of a volume: the division of the volume, and how slabs are stored and read.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <isonest/extract.h>
#include <isonest/int3.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

#include "query/march/mesh_part.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"

namespace isonest::detail {

// The surface in a slab of a volume, before slabs are joined.

/// Layers of cells: those between the planes `begin` and `end` of nodes, begin < end.
struct Slab {
    std::int64_t begin = 0;
    std::int64_t end = 0;
};

/// Expected size of the surface in a slab, used to reserve memory.
struct SlabEstimate {
    std::size_t vertices = 0;
    std::size_t triangles = 0;
};

struct MarchedSlab {
    using Point = std::array<float, 3>;
    /// A vertex on an edge of the lattice in a plane.
    struct OnPlane {
        std::uint64_t edge;  ///< number of the edge in the plane
        std::uint32_t vertex;
    };
    /// A vertex with a name; the next slab may have one with the same name. Its kind is fan or run,
    /// except in `shared`.
    struct Named {
        VertexKey key;
        std::uint32_t vertex;
        bool used;  ///< used by a triangle; otherwise it only records which vertices are the same
    };

    std::vector<Point> positions;  ///< of vertices, world coordinates; some vertices are in no
                                   ///< triangle
    /// Vertices that may be at the same place as others, ascending.
    std::vector<std::uint32_t> not_alone;
    std::vector<Point> normals;  ///< likewise; empty if not requested
    /// Cell by cell, x fastest, then y, then z.
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::array<std::vector<OnPlane>, 2> on_plane;  ///< in the first and last plane, ascending
    std::array<std::vector<Named>, 2> named;       ///< the same
    /// For a part of a slab, instead of these: everything that other parts and slabs may also have.
    std::vector<Named> shared;
    std::uint64_t cells = 0;  ///< cells with triangles
};

// The values of a slab of a volume: planes of nodes, dense, x fastest.

/// Does not own its data.
template <class T>
struct SlabValues {
    const T* data;       ///< of plane `first`
    std::int64_t first;  ///< number of the first plane
    Int3 nodes;          ///< of the volume

    /// The value at a node in the available planes.
    [[nodiscard]] const T* at(const Int3& p) const {
        return data + ((p.z - first) * nodes.y + p.y) * nodes.x + p.x;
    }
};

/// The gradient in world units by differences of neighbours, one-sided at borders: the same numbers
/// as NodeSampler::gradient() at level 0.
template <class T>
class SlabGradient {
  public:
    SlabGradient(const SlabValues<T>& values, const LatticeSteps& steps)
        : values_(values),
          steps_(steps),
          step_{1, values.nodes.x, values.nodes.x * values.nodes.y} {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            one_[axis] = 1 * steps.along[axis];
            two_[axis] = 2 * steps.along[axis];
        }
    }

    /// REQUIRES: the adjacent planes are available, where the volume has them.
    [[nodiscard]] Double3 operator()(const Int3& p) const {
        const T* const at = values_.at(p);
        Double3 g;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const std::int64_t low = p[axis] > 0 ? -step_[a] : 0;
            const std::int64_t high = p[axis] + 1 < values_.nodes[axis] ? step_[a] : 0;
            const double by = static_cast<double>(at[high]) - static_cast<double>(at[low]);
            g[a] = by / (steps_.is_uneven(a)     ? steps_.between(a, p[axis] - (low != 0 ? 1 : 0),
                                                                  p[axis] + (high != 0 ? 1 : 0))
                         : low != 0 && high != 0 ? two_[a]
                                                 : one_[a]);
        }
        return steps_.gradient(g);
    }
    /// Whether the node and the next one along `axis` have neighbours on all sides.
    [[nodiscard]] bool is_inner_edge(const Int3& p, int axis) const {
        const Int3& n = values_.nodes;
        return p.x > 0 && p.y > 0 && p.z > 0 && p.x + 1 + (axis == 0 ? 1 : 0) < n.x &&
               p.y + 1 + (axis == 1 ? 1 : 0) < n.y && p.z + 1 + (axis == 2 ? 1 : 0) < n.z;
    }
    /// Writes the differences for the gradient on an inner edge to row k: those over step() at its
    /// node `at` and at the next one along `axis`. REQUIRES: is_inner_edge(); regular
    /// steps.
    template <class Rows>
    void differences(const T* at, std::size_t axis, std::size_t k, Rows& from, Rows& to) const {
        const T* const next = at + step_[axis];
        for (std::size_t i = 0; i < 3; ++i) {
            const std::int64_t step = step_[i];
            from[i][k] = static_cast<double>(at[step]) - static_cast<double>(at[-step]);
            to[i][k] = static_cast<double>(next[step]) - static_cast<double>(next[-step]);
        }
    }
    [[nodiscard]] double step(std::size_t axis) const { return two_[axis]; }

  private:
    const SlabValues<T>& values_;
    LatticeSteps steps_;
    std::array<std::int64_t, 3> step_;
    Double3 one_{};
    Double3 two_{};
};

// Further parameters of the surface in a slab, besides the values.

struct SlabPlace {
    double iso = 0;
    bool normals = false;
    LatticeSteps steps = {};
    Double3 origin{};
    double sight = 0;  ///< distance from a node within which a vertex may be at the same place as
                       ///< others
};

// A volume's planes, slab by slab, from memory or from a reader.

/// Planes of nodes, dense, x fastest.
struct SlabPlanes {
    const std::byte* data = nullptr;  ///< of plane `first`
    std::int64_t first = 0;
    std::vector<std::byte> own = {};  ///< storage of the data, if it is not in the volume
};

/// Reads each plane once, in ascending order. Not thread-safe.
class SlabReader {
  public:
    explicit SlabReader(VolumeSource& volume);

    /// The planes of the layers, and one more on each side if the volume has it. REQUIRES: slabs
    /// are read in ascending order, without gaps, starting with the first layer. Throws what the
    /// volume throws.
    SlabPlanes read(const Slab& layers);

    /// Heap of the reader, and of each of its results, for slabs of this many layers, bytes.
    [[nodiscard]] std::uint64_t own_bytes(std::int64_t layers) const;
    [[nodiscard]] std::uint64_t slab_bytes(std::int64_t layers) const;

  private:
    VolumeSource& volume_;
    VolumeDescription description_;
    std::span<const std::byte> mapped_;
    std::uint64_t plane_bytes_;
    std::int64_t at_once_;  ///< number of planes read together
    std::vector<std::byte> window_;
    std::int64_t window_first_ = 0;  ///< its first plane
    std::int64_t window_end_ = 0;
};

// The range of the finite values in planes of a volume.

/// low > high: there are none.
struct ValueRange {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();

    void add(const ValueRange& other);
};

/// For planes [begin, end) of a volume of this many nodes. REQUIRES: the planes are available.
ValueRange range_of(ValueType type, const SlabPlanes& planes, const Int3& nodes, std::int64_t begin,
                    std::int64_t end);

// Which volumes can be marched, and how their layers are distributed.

/// Whether the volume, if its position is valid, can be marched along its axes.
bool is_marchable(const VolumeDescription& volume);

/// Throws Error{invalid_argument, unsupported, limit} for a volume that cannot be marched, and for
/// an isovalue that is not finite.
void require_marchable(const VolumeDescription& volume, double iso);

struct SlabPlan {
    std::int64_t layers = 1;  ///< per slab
    int slabs_at_once = 1;
    int threads = 1;
    std::uint64_t spare = 0;  ///< unused bytes of the memory
};

/// `each_more`: bytes that a slab needs in addition to its planes and a marcher. Throws
/// Error{limit}.
SlabPlan slab_plan(const SlabReader& reader, const VolumeDescription& volume,
                   const MemoryShare& memory, std::uint64_t each_more = 0);

/// The minimum memory required for a plan.
std::uint64_t min_slab_memory(const SlabReader& reader, const VolumeDescription& volume,
                              std::uint64_t each_more = 0);

}  // namespace isonest::detail
