// Attributes of a mesh vertex besides its position: normal, value, error.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "query/values/node_sampler.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Where the finest function has the isovalue on an edge of the nested grid.

/// The position, from 0 to 1, at which the linear function from one value to the other has the
/// isovalue. REQUIRES: the values are finite, and exactly one of them is below.
inline double crossing_of(double from, double to, double iso) {
    const double t = (iso - from) / (to - from);
    return std::isfinite(to - from) ? t : (iso / 4 - from / 4) / (to / 4 - from / 4);
}

/// Edges of the nested grid are only ever halved, so an edge is a chain of edges of the finest
/// mesh. The crossing is found by bisection: it depends only on the edge, and all tetrahedra at the
/// edge get the same crossing, at any level. Not thread-safe; one per thread.
class FinestCrossing {
  public:
    FinestCrossing(ChunkCache& cache, double iso) : nodes_(cache), iso_(iso) {}

    /// Nodes of the finest lattice, and the values there; one of them is below the isovalue.
    struct Edge {
        Int3 from;
        Int3 to;
        double from_value = 0;
        double to_value = 0;

        /// The position, from 0 to 1, at which the linear function has the isovalue.
        [[nodiscard]] double crossing(double iso) const {
            return crossing_of(from_value, to_value, iso);
        }
    };
    /// The edge between two nodes, in an order that depends only on the nodes.
    static Edge between(const Int3& a, double a_value, const Int3& b, double b_value);
    /// The finest edge of the chain with ends on different sides: the first one from `from` that
    /// bisection finds; or the shortest one with a missing value in the middle. Throws what the
    /// cache throws.
    [[nodiscard]] Edge finest(Edge edge);
    /// Releases all chunks.
    void leave() { nodes_.leave(); }
    /// Maximum number of chunks of values held at a time, in a store with this many levels.
    static std::uint64_t max_chunks(int levels) { return static_cast<std::uint64_t>(levels); }

  private:
    NodeSampler nodes_;
    double iso_;
};

/// Storage of attributes, as in a mesh file: a float32 is one word, a float64 two.
using AttributeWord = std::uint32_t;

/// The chosen attributes. Their order in a vertex is normal, value, error.
struct AttributeChoice {
    bool normal = false;  ///< 3 floats, unit length, toward smaller values, from the data's
                          ///< gradient; 0 where that is undefined (query/apart/complete_normals.h)
    bool value = false;   ///< of the store itself (slices), or of another store with the same nodes
    bool wide_value = false;  ///< stored as float64: see held_by_float32()
    /// Normals are those of the graph z = scale U over the xy plane instead.
    std::optional<double> graph_scale;
    /// All normals are this one instead (a slice's plane); any length.
    std::optional<Double3> plane_normal;
    std::optional<Field> error;  ///< the field at the midpoint of the vertex's tetrahedron edge

    /// One attribute within a vertex's words: `components` numbers from word `first` on.
    struct Array {
        const char* name;
        std::size_t first;
        std::size_t components;
        bool wide;  ///< float64
        [[nodiscard]] std::size_t bytes() const {
            return components * (wide ? sizeof(double) : sizeof(float));
        }
    };
    /// The chosen ones of "normal", "value", "error".
    [[nodiscard]] std::vector<Array> arrays() const;
    /// Words per vertex, and words in front of the value.
    [[nodiscard]] std::size_t width() const {
        return value_at() + value_words() + (error ? 1U : 0U);
    }
    [[nodiscard]] std::size_t value_at() const { return normal ? 3U : 0U; }
    /// Whether normals need the values around a vertex.
    [[nodiscard]] bool needs_gradient() const { return normal && !plane_normal; }
    [[nodiscard]] std::size_t value_words() const { return !value ? 0U : wide_value ? 2U : 1U; }
    /// Reads the value from a vertex's words. REQUIRES: value.
    [[nodiscard]] double value_of(std::span<const AttributeWord> words) const;
    /// Writes the value, rounded to float32 unless it is wide, and returns the stored number.
    double put_value(double number, std::span<AttributeWord> words) const;
};
inline constexpr std::size_t kMaxAttributes = 6;
using VertexAttributes = std::array<AttributeWord, kMaxAttributes>;

/// Whether float32 represents every value of the store exactly: not for float64, and not for 32-bit
/// integers beyond 2^24. Otherwise meshes store values as float64.
bool held_by_float32(const StoreReader& store);

/// Maximum rounding error of values, for vertices on edges and for cuts. The two are added only
/// when the maxima of all threads are known: otherwise the sum would depend on the distribution of
/// work.
struct ValueRounding {
    double at_edges = 0;
    double at_cuts = 0;  ///< by one cut, or by one mean of three

    void add(const ValueRounding& other) {
        at_edges = std::max(at_edges, other.at_edges);
        at_cuts = std::max(at_cuts, other.at_cuts);
    }
    [[nodiscard]] double sum() const {
        // How often a vertex can be a cut of the box through the edge of another cut: once for each
        // side.
        constexpr double kMaxCuts = 6;
        return at_edges + kMaxCuts * at_cuts;
    }
};

/// Computes attributes from the two nodes of a vertex's edge alone, so they are the same from every
/// brick, thread and tetrahedron. Differences are taken over the length of that edge: no finer data
/// is read than the surface itself needed (a vertex at a node uses the finest data). Not
/// thread-safe; one per thread.
class AttributeSampler {
  public:
    /// `values`: source of the values; null: the store itself.
    AttributeSampler(const AttributeChoice& choice, ChunkCache& own, ChunkCache* values);

    /// From now on the values at nodes come from this function instead of the store.
    void take_values(std::function<double(const Int3&)> of_node) { of_node_ = std::move(of_node); }

    [[nodiscard]] std::size_t width() const { return width_; }
    /// At a + t (b - a), the ends of an edge of the nested grid.
    [[nodiscard]] VertexAttributes edge(const Int3& a, const Int3& b, double t);
    [[nodiscard]] VertexAttributes node(const Int3& p);
    /// Component-wise a + t (b - a), and the mean of three.
    [[nodiscard]] VertexAttributes mix(const VertexAttributes& a, const VertexAttributes& b,
                                       double t);
    [[nodiscard]] VertexAttributes mean(const VertexAttributes& a, const VertexAttributes& b,
                                        const VertexAttributes& c);
    /// The same attributes with the normal scaled to unit length (mixing shortens it); 0 stays 0.
    [[nodiscard]] VertexAttributes with_unit_normal(const VertexAttributes& a) const;
    /// For the values computed so far.
    [[nodiscard]] const ValueRounding& value_rounding() const { return value_rounding_; }

    /// See NodeSampler.
    void enter(int level, const Int3& node);
    void leave();

  private:
    [[nodiscard]] VertexAttributes sample(const Int3& a, const Int3& b, double t, bool with_error);
    /// A node's value, from any level that has it; between enter() and leave() the level of the
    /// brick, whose chunks are loaded.
    [[nodiscard]] double value(const Int3& p, int level);

    AttributeChoice choice_;
    std::size_t width_;
    NodeSampler own_;
    NodeSampler values_;
    std::function<double(const Int3&)> of_node_;  ///< or empty
    std::optional<int> home_level_;
    ValueRounding value_rounding_;
};

}  // namespace isonest::detail
