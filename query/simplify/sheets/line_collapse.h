// The collapse of an edge of a line in which sheets meet, in all of the sheets at once.
//
// The vertex that goes is first moved onto the straight line between its two neighbours on the
// line, by which all points of the triangles around it move by a part of that vector; then each
// sheet is mapped by itself (query/simplify/mapping/fan_overlay.h), whose border is straight there,
// and stays what it is. So the sheets still meet.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/mapping/star_mapping.h"
#include "query/simplify/sheets/nodes_passed.h"
#include "query/simplify/sheets/sheet_lines.h"

namespace isonest::detail {

/// Not thread-safe.
class LineCollapse {
  public:
    static constexpr double kRefused = std::numeric_limits<double>::infinity();

    /// `locked`: vertices that stay. All have to stay.
    LineCollapse(std::span<const std::array<float, 3>> positions, const SheetLines& lines,
                 const std::vector<bool>& locked, const CornerMesh& mesh, StarCollapse& collapse,
                 StarMapping& mapping)
        : positions_(positions),
          lines_(lines),
          locked_(locked),
          mesh_(mesh),
          collapse_(collapse),
          mapping_(mapping) {}

    /// No node is passed over from now on.
    void keep(const NodesPassed& nodes) { nodes_ = &nodes; }

    /// The largest bound of the triangles that there would be if `from` became `to` in all sheets;
    /// kRefused if one is above `limit`, or where topology or folds (their least cosine:
    /// has_no_new_fold()) are in the way. `from` is the first of its copies.
    [[nodiscard]] double look(std::uint32_t from, std::uint32_t to, double limit, float least);
    /// Makes the collapse; of `from` the queue is not told. How many triangles fewer there are.
    /// REQUIRES: look() was not refused, and nothing has changed since.
    std::uint32_t take(EdgeQueue& queue);

  private:
    /// One sheet's copies of the vertex that goes, of what it becomes, and of the other neighbour.
    struct Copies {
        std::uint32_t from;
        std::uint32_t to;
        std::uint32_t beyond;
    };
    [[nodiscard]] bool find_copies(std::uint32_t from, std::uint32_t to);
    [[nodiscard]] bool have_edge(std::uint32_t a, std::uint32_t b) const;
    [[nodiscard]] bool find_slide();
    [[nodiscard]] bool passes_node(std::uint32_t from) const;
    [[nodiscard]] double look_in_sheet(const Copies& copies, double limit, float least);

    std::span<const std::array<float, 3>> positions_;
    const SheetLines& lines_;
    const std::vector<bool>& locked_;
    const CornerMesh& mesh_;
    StarCollapse& collapse_;
    StarMapping& mapping_;
    std::vector<Copies> sheets_;
    Double3 slide_{};
    const NodesPassed* nodes_ = nullptr;
    double limit_ = 0;
    float least_ = 0;
    mutable CornerMesh::Ring ring_;
};

}  // namespace isonest::detail
