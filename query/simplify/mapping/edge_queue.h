// Which edge of a corner mesh is collapsed next: the one by which the surface changes least.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997. What the quadrics estimate is an order and no promise.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/collapse/quadric.h"
#include "query/simplify/mapping/corner_mesh.h"

namespace isonest::detail {

/// Not thread-safe.
class EdgeQueue {
  public:
    struct Edge {
        float square_error;  ///< world units
        std::uint32_t from;
        std::uint32_t to;
        std::uint32_t version;  ///< of the quadric of `from`
    };

    /// Edges whose error is larger than `most` (world units, squared) never come. The arguments have
    /// to stay.
    EdgeQueue(std::span<const std::array<float, 3>> positions, const CornerMesh& mesh, float most);

    /// From now on the edges from `v` are waiting.
    void add(std::uint32_t v);
    /// Nothing: none waits.
    std::optional<Edge> next();
    /// `from` was collapsed into `to`, around which `ring` lies; the edges there wait again, but
    /// for those from vertices that are locked.
    void collapsed(std::uint32_t from, const CornerMesh::Ring& ring,
                   const std::vector<bool>& locked);

  private:
    [[nodiscard]] Double3 at(std::uint32_t v) const {
        const auto& p = positions_[v];
        return {static_cast<double>(p[0]) - origin_[0], static_cast<double>(p[1]) - origin_[1],
                static_cast<double>(p[2]) - origin_[2]};
    }
    void add_quadrics(std::uint32_t triangle);
    void push(const Edge& edge);
    void push_next(std::uint32_t from, float after, std::uint32_t after_to);
    [[nodiscard]] float square_error(std::uint32_t from, std::uint32_t to) const {
        return static_cast<float>(quadrics_[from].mean(at(to)));
    }

    std::span<const std::array<float, 3>> positions_;
    const CornerMesh& mesh_;
    float most_;  ///< square error
    Double3 origin_{};
    std::vector<Quadric> quadrics_;
    std::vector<std::uint32_t> version_;
    std::vector<Edge> heap_;
    CornerMesh::Ring ring_;
};

}  // namespace isonest::detail
