// What a mesh vertex carries beside its position: normal, value, error.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "query/view/node_sampler.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// What a vertex carries, as a mesh file holds it: a float32 is one word, a float64 two.
using AttributeWord = std::uint32_t;

/// Which attributes; the order in a vertex is normal, value, error.
struct AttributeChoice {
    bool normal = false;  ///< 3 floats, unit length, toward smaller values, from the data's
                          ///< gradient; 0 where that says nothing (query/apart/complete_normals.h)
    bool value = false;   ///< of the store itself (slices), or of another one with the same nodes
    bool wide_value = false;  ///< as float64: see held_by_float32()
    /// normal is that of the graph z = scale U over the xy plane instead.
    std::optional<double> graph_scale;
    /// normal is this one instead, of any length: that of a slice's plane.
    std::optional<Double3> plane_normal;
    std::optional<Field> error;  ///< the field at the midpoint of the vertex's tetrahedron edge

    /// One of them in a vertex's words: `components` numbers from word `first` on.
    struct Array {
        const char* name;
        std::size_t first;
        std::size_t components;
        bool wide;  ///< float64
        [[nodiscard]] std::size_t bytes() const {
            return components * (wide ? sizeof(double) : sizeof(float));
        }
    };
    /// "normal", "value", "error", as far as chosen.
    [[nodiscard]] std::vector<Array> arrays() const;
    /// Words of a vertex, and those in front of the value.
    [[nodiscard]] std::size_t width() const {
        return value_at() + value_words() + (error ? 1U : 0U);
    }
    [[nodiscard]] std::size_t value_at() const { return normal ? 3U : 0U; }
    /// Whether normals need the values around a vertex.
    [[nodiscard]] bool needs_gradient() const { return normal && !plane_normal; }
    [[nodiscard]] std::size_t value_words() const { return !value ? 0U : wide_value ? 2U : 1U; }
    /// The value among a vertex's words. REQUIRES: value.
    [[nodiscard]] double value_of(std::span<const AttributeWord> words) const;
    /// Writes it there, rounded to float32 unless it is wide, and returns what is then there.
    double put_value(double number, std::span<AttributeWord> words) const;
};
inline constexpr std::size_t kMostAttributes = 6;
using VertexAttributes = std::array<AttributeWord, kMostAttributes>;

/// Whether float32 holds each value of the store as it is: not float64, and not 32-bit integers
/// beyond 2^24. Where it does not, meshes carry values as float64.
bool held_by_float32(const StoreReader& store);

/// Most by which values are off because they were rounded, over vertices on edges and over cuts.
/// The two are added where all threads' largest are known: else the sum would depend on who
/// computed what.
struct ValueRounding {
    double at_edges = 0;
    double at_cuts = 0;  ///< by one cut, or one mean of three

    void add(const ValueRounding& other) {
        at_edges = std::max(at_edges, other.at_edges);
        at_cuts = std::max(at_cuts, other.at_cuts);
    }
    [[nodiscard]] double sum() const {
        // How often a vertex can be one of a box's cuts through another's edge: once for each side.
        constexpr double kMostCuts = 6;
        return at_edges + kMostCuts * at_cuts;
    }
};

/// Computes them from the two nodes of a vertex's edge alone, and so the same from every brick,
/// thread and tetrahedron. Differences are taken over the length of that edge: no finer data are
/// read than the surface itself needed (a vertex in a node takes the finest). Not thread-safe; one
/// per thread.
class AttributeSampler {
  public:
    /// `values`: where values are taken from; the store itself if null.
    AttributeSampler(const AttributeChoice& choice, ChunkCache& own, ChunkCache* values);

    /// From now on the values of nodes are those of the function, not the store's.
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
    /// The same attributes with a normal of unit length, which a mixed one has not; or 0.
    [[nodiscard]] VertexAttributes with_unit_normal(const VertexAttributes& a) const;
    /// Of the values that were computed so far.
    [[nodiscard]] const ValueRounding& value_rounding() const { return value_rounding_; }

    /// See NodeSampler.
    void enter(int level, const Int3& node);
    void leave();

  private:
    [[nodiscard]] VertexAttributes sample(const Int3& a, const Int3& b, double t, bool with_error);
    /// A node's value, of whichever level that has it: between enter() and leave() that of the
    /// brick, whose chunks are there.
    [[nodiscard]] double value(const Int3& p, int level);

    AttributeChoice choice_;
    std::size_t width_;
    NodeSampler own_;
    NodeSampler values_;
    std::function<double(const Int3&)> of_node_;  ///< or empty
    std::optional<int> home_level_;
    Double3 spacing_;
    ValueRounding value_rounding_;
};

}  // namespace isonest::detail
