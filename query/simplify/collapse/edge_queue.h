// Which edge of a corner mesh is collapsed next: the one by which the surface changes least.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997. What the quadrics estimate is an order and no promise.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/quadric.h"

namespace isonest::detail {

/// Square errors of edges (world units), in bins of a sixteenth of a power of two.
inline std::size_t bin_of(float square_error) {
    constexpr float kLeast = 1e-30F;
    return std::bit_cast<std::uint32_t>(square_error + kLeast) >> 19U;
}
/// No error in the bin is larger.
inline float end_of_bin(std::size_t bin) {
    return std::bit_cast<float>(static_cast<std::uint32_t>((bin + 1) << 19U) - 1);
}

/// Not thread-safe.
class EdgeQueue {
  public:
    struct Edge {
        float square_error;  ///< world units
        std::uint32_t from;
        std::uint32_t to;
        std::uint32_t state;

        /// Of the quadric of `from`.
        [[nodiscard]] std::uint32_t version() const { return state / 2; }
        /// Edges from `from` of larger errors do not wait yet.
        [[nodiscard]] bool has_others() const { return state % 2 != 0; }
    };

    /// Edges whose error is larger than `most` (world units, squared) never come. The arguments
    /// have to stay; positions of vertices that edges were collapsed into may change.
    EdgeQueue(std::span<const std::array<float, 3>> positions, const CornerMesh& mesh, float most);

    /// From now on the edges from `v` are waiting.
    void add(std::uint32_t v);
    /// One of the smallest error, to a sixteenth of its power of two. Nothing: none waits.
    std::optional<Edge> next();
    /// The edge that came last stays. `ring`: around its start.
    void stays(const Edge& edge, const CornerMesh::Ring& ring);
    /// The edge that came last waits again, until what comes has such an error.
    void defer(const Edge& edge, float square_error) {
        push({square_error, edge.from, edge.to, 2 * edge.version()});
    }
    /// Whether the edge from its end to its start has a smaller error: it comes sooner.
    [[nodiscard]] bool comes_later_than_back(const Edge& edge) const {
        return square_error(edge.to, edge.from) < edge.square_error;
    }
    /// Of the edge that came last.
    [[nodiscard]] std::size_t bin() const { return lowest_; }
    /// Where the surface changes least if both vertices go there.
    [[nodiscard]] std::optional<Double3> lowest(std::uint32_t from, std::uint32_t to) const {
        Quadric both = quadrics_[from];
        both.add(quadrics_[to]);
        const std::optional<Double3> p = both.lowest(at(to));
        return p ? std::optional(
                       Double3{(*p)[0] + origin_[0], (*p)[1] + origin_[1], (*p)[2] + origin_[2]})
                 : std::nullopt;
    }
    /// `from` was collapsed into `to`, around which `ring` lies; the edges there wait again, but
    /// for those from vertices that are locked.
    void collapsed(std::uint32_t from, const CornerMesh::Ring& ring,
                   const std::vector<bool>& locked);

  private:
    /// Edges of errors that are nearly the same, first come, first served.
    struct Bin {
        std::uint32_t first = CornerMesh::kNone;
        std::uint32_t last = CornerMesh::kNone;
    };
    struct Waiting {
        Edge edge;
        std::uint32_t next;  ///< in its bin, or of those that are free
    };
    [[nodiscard]] Double3 at(std::uint32_t v) const {
        const auto& p = positions_[v];
        return {static_cast<double>(p[0]) - origin_[0], static_cast<double>(p[1]) - origin_[1],
                static_cast<double>(p[2]) - origin_[2]};
    }
    void add_quadrics(std::uint32_t triangle);
    void push(const Edge& edge);
    void push_next(const CornerMesh::Ring& ring, float after, std::uint32_t after_to);
    [[nodiscard]] float square_error(std::uint32_t from, std::uint32_t to) const {
        return static_cast<float>(quadrics_[from].mean(at(to)));
    }

    std::span<const std::array<float, 3>> positions_;
    const CornerMesh& mesh_;
    float most_;  ///< square error
    Double3 origin_{};
    std::vector<Quadric> quadrics_;
    std::vector<std::uint32_t> version_;
    std::vector<Waiting> waiting_;
    std::uint32_t free_ = CornerMesh::kNone;  ///< in waiting_
    std::vector<Bin> bins_;
    std::size_t lowest_ = 0;  ///< no bin before it has an edge
    CornerMesh::Ring ring_;
};

}  // namespace isonest::detail
