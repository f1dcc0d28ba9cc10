// How far the triangles of a leaf are from the full surface within the leaf, and the other way
// round.
//
// The distance from a convex set is a convex function: over a convex polygon it is largest at a
// corner. So a polygon that lies within a distance of one triangle at all its corners does so
// everywhere. What is compared with an element's triangles are not those of the finest level, but
// those of its descendants kOctaves levels below, with the distances that these have themselves: by
// the triangle inequality the sum is a bound, as in section 5 of Gerstner, Rumpf, Weikard (2000).
// An element's triangles are cut by its descendants, as they are bisected, so that each piece is
// compared with the triangles of the element that it lies in first.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/distance/element_polygon.h"

namespace isonest::detail {

/// The elements of one subtree, children before their parents. Not thread-safe.
class ElementErrors {
  public:
    /// Bisections between an element and the descendants that it is compared with.
    static constexpr int kBelow = 6;
    static constexpr std::int32_t kNoSurface = -1;

    /// `limit`: world units; what is larger counts as infinite.
    ElementErrors(const Double3& spacing, double limit) : spacing_(spacing), limit_(limit) {}

    /// How many descendants of earlier elements are known.
    struct Mark {
        std::size_t nodes = 0;
        std::size_t triangles = 0;
    };
    /// REQUIRES: called before the element's children are added.
    [[nodiscard]] Mark mark(const Element<3>& t) const;
    /// An element of the finest level: its number, or kNoSurface.
    std::int32_t add_finest(const ElementPolygon& polygon);
    /// An element above, its children's numbers known. The distance is infinite if the element has
    /// triangles and its descendants have none, or the other way round, and if a child's is.
    /// `bounded`: false if it is to be infinite in any case.
    std::int32_t add(const Element<3>& t, const ElementPolygon& polygon,
                     const std::array<std::int32_t, 2>& children, const Mark& mark, bool bounded);
    /// Of an element that was added last, or as a child of that one.
    [[nodiscard]] double error(int height, std::int32_t element) const;

    /// Bisections above the finest level.
    static int height_of(const Element<3>& t) { return 3 * t.level - t.kind; }

  private:
    /// Distances to the full surface within the element, and from it.
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
        std::uint32_t first = 0;  ///< among the triangles of its height
        std::uint32_t count = 0;
        bool has_triangles = false;  ///< at the finest level
        Error error;
    };
    struct Corners {
        static constexpr std::size_t kMost = 16;
        std::array<Double3, kMost> at;
        std::size_t count = 0;
        void add(const Double3& p) { at[count++] = p; }
    };
    struct Piece {
        static constexpr std::size_t kMost = 12;
        std::array<Barycentric, kMost> place;
        std::size_t count = 0;
    };
    /// Where two triangles meet, as a plane across them.
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

    Double3 spacing_;
    double limit_;
    // By height, modulo kBelow + 1: no other heights are asked for.
    std::array<std::vector<Node>, kBelow + 1> nodes_;
    std::array<std::vector<Candidate>, kBelow + 1> triangles_;
    // What is measured.
    int base_ = 0;           ///< height of the descendants
    std::size_t first_ = 0;  ///< of their triangles
    double from_ = 0;        ///< the largest distance so far
};

}  // namespace isonest::detail
