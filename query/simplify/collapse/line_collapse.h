// The collapse of an edge on a line where sheets meet, in all of the sheets at once.
//
// The vertex to be removed is first moved onto the straight line between its two neighbours on the
// line; all points of the triangles around it move by a part of that vector. Then each sheet is
// mapped on its own (query/simplify/collapse/star_mapping.h); its border is straight there and does
// not change. So the sheets still meet.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/collapse/star_mapping.h"

namespace isonest::detail {

// The vertices of a patch where several sheets meet.

/// In patches where no sheets meet, every vertex is single. Thread-safety: constant data.
class SheetLines {
  public:
    /// `next_copy`: for each vertex, the next copy of the same vertex, in rings; empty: every
    /// vertex is single. `locked`: vertices that are kept; vertices with a locked copy are added.
    SheetLines(std::span<const std::uint32_t> next_copy, std::vector<bool>& locked);

    [[nodiscard]] bool is_line(std::uint32_t v) const { return !next_.empty() && next_[v] != v; }
    [[nodiscard]] std::uint32_t next(std::uint32_t v) const { return next_[v]; }
    /// The smallest of the copies.
    [[nodiscard]] std::uint32_t first(std::uint32_t v) const {
        return first_.empty() ? v : first_[v];
    }
    /// Locked vertices and those on lines: other sheets also have their edges.
    [[nodiscard]] const std::vector<bool>& known() const { return known_; }
    /// Locked vertices and all copies except the first.
    [[nodiscard]] const std::vector<bool>& silent() const { return silent_; }

  private:
    std::span<const std::uint32_t> next_;
    std::vector<std::uint32_t> first_;
    std::vector<bool> known_;
    std::vector<bool> silent_;
};

/// Not thread-safe.
class LineCollapse {
  public:
    static constexpr double kRefused = std::numeric_limits<double>::infinity();

    /// `locked`: vertices that are kept. All arguments must outlive it.
    LineCollapse(std::span<const std::array<float, 3>> positions, const SheetLines& lines,
                 const std::vector<bool>& locked, const CornerMesh& mesh, StarCollapse& collapse,
                 StarMapping& mapping)
        : positions_(positions),
          lines_(lines),
          locked_(locked),
          mesh_(mesh),
          collapse_(collapse),
          mapping_(mapping) {}

    /// From now on the surface must not pass over nodes.
    void keep(const NodesPassed& nodes) { nodes_ = &nodes; }

    /// The largest bound of the resulting triangles if `from` became `to` in all sheets; kRefused
    /// if one is above `limit`, or if topology or folds (their least cosine: has_no_new_fold())
    /// prevent it. `from` is the first of its copies.
    [[nodiscard]] double look(std::uint32_t from, std::uint32_t to, double limit, float least);
    /// Performs the collapse; the queue is not told about `from`. Returns the number of removed
    /// triangles. REQUIRES: look() was not refused, and nothing has changed since.
    std::uint32_t take(EdgeQueue& queue);

  private:
    /// One sheet's copies of the removed vertex, of the vertex that it becomes, and of the other
    /// neighbour.
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
    float min_ = 0;
    mutable CornerMesh::Ring ring_;
};

}  // namespace isonest::detail
