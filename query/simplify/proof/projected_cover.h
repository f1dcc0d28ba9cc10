// Whether a triangle lies near a surface, by projecting the surface onto it.
//
// Starting near a corner of the triangle, the surface is followed across all edges whose projection
// to the triangle's plane meets the triangle. If none of these is a border, the projection of the
// followed part has no border inside the triangle. So the number of times that it covers a point
// (front sides minus back sides) is the same for all points of the triangle: the degree of a map
// (J. Milnor, "Topology from the Differentiable Viewpoint", 1965, section 5). If it is not 0 at one
// point, it is 0 nowhere: then each point of the triangle has a point of the surface straight above
// or below it, at most as far away as the height of the followed part over the triangle.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Not thread-safe.
class ProjectedCover {
  public:
    /// `positions` and `surface` must outlive this object; `limit`: > 0, world units.
    ProjectedCover(std::span<const std::array<float, 3>> positions,
                   std::span<const PatchTriangle> surface, double limit);

    /// A distance, at most the limit, such that all points of the triangle are within it of the
    /// surface. Nothing: none could be proven. `near`: a vertex of the surface where it starts: the
    /// one at the first corner, or one near the triangle. REQUIRES: the triangle has an area.
    [[nodiscard]] std::optional<double> covers(const Triangle& triangle, std::uint32_t near);

  private:
    /// A projected vertex: position in the plane, distances inside the three edges, and height.
    struct Seen {
        double u, v, height;
        std::array<double, 3> inside;
    };
    using SeenTriangle = std::array<const Seen*, 3>;
    struct Polygon {
        std::array<Seen, 10> corner{};
        std::size_t count = 0;
    };
    void look_at(const std::array<Double3, 3>& t);
    const Seen& seen(std::uint32_t vertex);
    [[nodiscard]] bool meets(const Seen& p, const Seen& q, double inside) const;
    template <class Inside>
    static void cut(Polygon& polygon, const Inside& inside);
    [[nodiscard]] double height_over(const SeenTriangle& t) const;
    [[nodiscard]] int turns_around_middle(const SeenTriangle& t) const;
    [[nodiscard]] std::uint32_t beyond(std::uint32_t triangle, std::size_t edge) const;
    std::uint32_t start(std::uint32_t vertex);
    bool begin(const Triangle& triangle, std::uint32_t near);
    void visit(std::uint32_t triangle);

    std::span<const std::array<float, 3>> positions_;
    std::span<const PatchTriangle> surface_;
    double limit_;
    std::vector<std::uint32_t> first_;                  ///< for each vertex, index into around_
    std::vector<std::uint32_t> around_;                 ///< triangles of each vertex
    std::vector<std::array<std::uint32_t, 3>> beyond_;  ///< triangle beyond each edge, from corner
                                                        ///< i to i + 1

    // The current triangle.
    Double3 origin_{};
    Double3 along_{};
    Double3 across_{};
    Double3 up_{};
    std::array<std::array<double, 2>, 3> corner_{};
    std::array<std::array<double, 3>, 3> edge_{};  ///< inside = e[0] u + e[1] v + e[2]
    std::array<double, 2> middle_{};
    double tiny_ = 0;
    std::uint32_t question_ = 0;
    std::vector<std::uint32_t> visited_in_;
    std::vector<std::uint32_t> seen_in_;
    std::vector<Seen> seen_;  ///< vertices
    std::vector<std::uint32_t> stack_;
};

}  // namespace isonest::detail
