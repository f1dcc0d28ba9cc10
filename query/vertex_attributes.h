// What a mesh vertex carries beside its position: normal, value, error.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "query/node_sampler.h"

namespace isonest {

/// Which attributes; the order in a vertex is normal, value, error.
struct AttributeChoice {
    bool normal =
        false;           ///< 3 floats, unit length, toward smaller values, from the data's gradient
    bool value = false;  ///< of the store itself (slices), or of another one with the same nodes
    /// normal is that of the graph z = scale U over the xy plane instead.
    std::optional<double> graph_scale;
    std::optional<Field> error;  ///< the field at the midpoint of the vertex's tetrahedron edge

    /// One of them in a vertex's numbers: `components` from number `first` on.
    struct Array {
        const char* name;
        std::size_t first;
        std::size_t components;
    };
    /// "normal", "value", "error", as far as chosen.
    [[nodiscard]] std::vector<Array> arrays() const;
    [[nodiscard]] std::size_t width() const {
        return (normal ? 3U : 0U) + (value ? 1U : 0U) + (error ? 1U : 0U);
    }
};
inline constexpr std::size_t kMostAttributes = 5;
using VertexAttributes = std::array<float, kMostAttributes>;

/// Computes them from the two nodes of a vertex's edge alone, and so the same from every brick,
/// thread and tetrahedron. Differences are taken over the length of that edge: no finer data are
/// read than the surface itself needed (a vertex in a node takes the finest). Not thread-safe; one
/// per thread.
class AttributeSampler {
  public:
    /// `values`: where values are taken from; the store itself if null.
    AttributeSampler(const AttributeChoice& choice, ChunkCache& own, ChunkCache* values);

    [[nodiscard]] std::size_t width() const { return width_; }
    /// At a + t (b - a), the ends of an edge of the nested grid.
    [[nodiscard]] VertexAttributes edge(const Int3& a, const Int3& b, double t);
    [[nodiscard]] VertexAttributes node(const Int3& p);

    /// See NodeSampler.
    void enter(int level, const Int3& node);
    void leave();

  private:
    [[nodiscard]] VertexAttributes sample(const Int3& a, const Int3& b, double t, bool with_error);

    AttributeChoice choice_;
    std::size_t width_;
    NodeSampler own_;
    NodeSampler values_;
    Double3 spacing_;
};

/// Component-wise a + t (b - a).
VertexAttributes mix(const VertexAttributes& a, const VertexAttributes& b, double t);

}  // namespace isonest
