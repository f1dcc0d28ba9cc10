// The distance, in both directions, between the triangles of a leaf and the full surface within the
// leaf.
//
// The distance from a convex set is a convex function, so over a convex polygon its maximum is at a
// corner: if all corners of a polygon are within a distance of one triangle, so is the whole
// polygon. An element's triangles are not compared with those of the finest level, but with those
// of its descendants kBelow bisections below, plus the distances of these: by the triangle
// inequality the sum is a bound, as in section 5 of Gerstner, Rumpf, Weikard (2000). An element's
// triangles are divided by its descendants in the same way as these are bisected, so that each
// piece is first compared with the triangles of the element that contains it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "query/march/vertex_attributes.h"
#include "query/simplify/block_files.h"
#include "query/simplify/proof/point_triangle.h"
#include "query/traverse/adapt_traverse.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The surface within one element of the nested grid: the triangles that represent a leaf, with
// exact vertices.

using Barycentric = std::array<double, 4>;

/// Whether det(v1 - v0, v2 - v0, v3 - v0) > 0.
bool is_positive(const Element<3>& t);

/// No corner, or three, or four: then the triangles are 0 1 2 and 0 2 3. As a set of points it is
/// the result of LocalMesh::march() for the element.
struct ElementPolygon {
    std::array<Double3, 4> at{};         ///< steps.vector() of lattice coordinates
    std::array<Barycentric, 4> place{};  ///< the same, in coordinates of the element
    std::size_t count = 0;
    /// Whether corners of the element are on both sides of the isovalue: then its neighbours must
    /// take it into account, even if they only meet it at a node or along an edge.
    bool is_crossed = false;

    [[nodiscard]] std::size_t triangles() const { return count == 0 ? 0 : count - 2; }
    [[nodiscard]] Triangle triangle(std::size_t i) const { return {at[0], at[i + 1], at[i + 2]}; }
};

/// REQUIRES: t.is_complete(). There are also no corners if the element's share is only an edge or a
/// node. Throws what the crossing throws.
ElementPolygon element_polygon(const Element<3>& t, double iso, const LatticeSteps& steps,
                               FinestCrossing& crossing);

/// The elements of one subtree, children before their parents. Not thread-safe.
class ElementErrors {
  public:
    /// Number of bisections between an element and the descendants with which it is compared.
    static constexpr int kBelow = 6;
    static constexpr std::int32_t kNoSurface = -1;

    /// `limit`: world units; larger distances count as infinite.
    ElementErrors(const LatticeSteps& steps, double limit) : steps_(steps), limit_(limit) {}

    /// How many descendants of earlier elements are recorded.
    struct Mark {
        std::size_t nodes = 0;
        std::size_t triangles = 0;
    };
    /// REQUIRES: called before the element's children are added.
    [[nodiscard]] Mark mark(const Element<3>& t) const;
    /// Adds an element of the finest level. Returns its number, or kNoSurface.
    std::int32_t add_finest(const ElementPolygon& polygon);
    /// Adds a coarser element, after its children. The distance is infinite if the element has
    /// triangles and its descendants have none, or vice versa, and if that of a child is infinite.
    /// `bounded`: false to make it infinite in any case.
    std::int32_t add(const Element<3>& t, const ElementPolygon& polygon,
                     const std::array<std::int32_t, 2>& children, const Mark& mark, bool bounded);
    /// The error of the element that was added last, or of a child of that one.
    [[nodiscard]] double error(int height, std::int32_t element) const;

    /// Number of bisections above the finest level.
    static int height_of(const Element<3>& t) { return 3 * t.level - t.kind; }

  private:
    /// Distances to and from the full surface within the element.
    struct Error {
        double to = 0;
        double from = 0;
    };
    struct Candidate {
        Triangle triangle{};
        Error error;
    };
    struct Node {
        std::array<std::int32_t, 2> children{kNoSurface, kNoSurface};
        std::uint32_t first = 0;  ///< index among the triangles of its height
        std::uint32_t count = 0;
        bool has_triangles = false;  ///< at the finest level
        Error error;
    };
    struct Corners {
        static constexpr std::size_t kMax = 16;
        std::array<Double3, kMax> at;
        std::size_t count = 0;
        void add(const Double3& p) { at[count++] = p; }
    };
    struct Piece {
        static constexpr std::size_t kMax = 12;
        std::array<Barycentric, kMax> place;
        std::size_t count = 0;
    };
    /// A plane through the place where two triangles meet, across them.
    struct Fold {
        Double3 normal{};
        double offset = 0;
    };

    std::int32_t push(int height, const ElementPolygon& polygon, const Node& node);
    Error measure(const Element<3>& t, const ElementPolygon& polygon,
                  const std::array<std::int32_t, 2>& children);
    bool follow(const Element<3>& t, const std::array<std::int32_t, 2>& children,
                const Piece& piece);
    bool compare(const Element<3>& t, std::int32_t element, const Piece& piece);
    [[nodiscard]] double from_nearest(const Corners& corners,
                                      std::span<const Candidate> candidates) const;
    [[nodiscard]] std::span<const Candidate> candidates() const;
    static std::size_t slot(int height) { return static_cast<std::size_t>(height % (kBelow + 1)); }
    static Fold fold_of(const Triangle& a, const Triangle& b);
    static std::array<Corners, 2> cut(const Corners& corners, const Fold& fold);
    static double furthest(const Corners& corners, const Triangle& triangle);

    LatticeSteps steps_;
    double limit_;
    // By height, modulo kBelow + 1: other heights are not needed.
    std::array<std::vector<Node>, kBelow + 1> nodes_;
    std::array<std::vector<Candidate>, kBelow + 1> triangles_;
    // The current measurement.
    int base_ = 0;           ///< height of the descendants
    std::size_t first_ = 0;  ///< index of their first triangle
    double from_ = 0;        ///< the largest distance so far
};

// The saturated distances of all elements that share a refinement node, for one isovalue.
//
// Saturation is that of the paper (section 2): a node's number is at least that of the nodes where
// its elements' children are refined. It is done bisection by bisection, starting with the finest.

/// Nodes are identified by half_lattice_key() of twice the node.
struct NodeError {
    std::uint64_t node = 0;
    float error = 0;
};
/// An element's refinement node and that of one of its children.
struct NodeLink {
    std::uint64_t parent = 0;
    std::uint64_t child = 0;
    int height = 0;  ///< of the child: number of bisections above the finest level
};

/// Data that grows with the surface is kept in temporary files. Thread-safety: at() from any thread
/// after saturate(), the rest from one.
class NodeErrors {
  public:
    /// REQUIRES: all heights are less than this.
    static constexpr int kHeights = 16;

    explicit NodeErrors(ScratchFolder folder);
    /// Throws Error{io}.
    void append(std::span<const NodeError> errors, std::span<const NodeLink> links);
    /// Call after the last append(). Throws Error{io}.
    void saturate();
    /// Returns 0 at nodes of no appended element.
    [[nodiscard]] double at(std::uint64_t node) const;

  private:
    struct Pair {
        std::uint64_t parent = 0;
        std::uint64_t child = 0;
    };
    [[nodiscard]] NodeError& place(std::uint64_t node) const;

    ScratchFolder folder_;
    GrowingFile<NodeError> errors_;
    std::vector<std::unique_ptr<GrowingFile<Pair>>> links_;  ///< by height
    ScratchFile table_;                                      ///< hashed; 0 is no node
    std::uint64_t mask_ = 0;
};

}  // namespace isonest::detail
