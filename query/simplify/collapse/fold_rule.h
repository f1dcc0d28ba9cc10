// Which collapses fold a surface onto itself.
//
// An edge is a fold where the normals of its two triangles are more than 120 degrees apart. A
// collapse may leave folds that were there, none that are sharper.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "query/simplify/collapse/collapsing_patch.h"

namespace isonest::detail {

/// Not thread-safe.
class FoldRule {
  public:
    /// Both have to stay.
    FoldRule(const Patch& patch, const CollapsingPatch& mesh) : patch_(patch), mesh_(mesh) {}

    /// Whether the sharpest edge of the triangles around `from`, their outer edges among them, is
    /// no fold once `from` has moved to `to`, or no sharper than before. False where a triangle
    /// that is not in the patch may lie across one of the edges. REQUIRES: mesh.is_allowed(from,
    /// to).
    bool allows(std::uint32_t from, std::uint32_t to);

  private:
    /// A triangle around the vertex, as (vertex, a, b).
    struct Wedge {
        std::uint32_t a = 0;
        std::uint32_t b = 0;
        std::uint32_t triangle = 0;
        bool is_gone = false;  ///< after the collapse
        Double3 before{};      ///< normals of length 1, or 0
        Double3 after{};
    };

    [[nodiscard]] Double3 normal(std::uint32_t a, std::uint32_t b, std::uint32_t c) const;
    [[nodiscard]] bool is_unseen(std::uint32_t a, std::uint32_t b) const {
        return patch_.shared[a] && patch_.shared[b];
    }
    /// The place of the triangle with the edge that is not one of `from`, if there is one.
    [[nodiscard]] std::optional<std::uint32_t> across(std::uint32_t a, std::uint32_t b,
                                                      std::uint32_t from) const;
    /// Finds the wedges, and what lies across their outer edges; false where that may be unseen.
    bool look(std::uint32_t from, std::uint32_t to);

    const Patch& patch_;
    const CollapsingPatch& mesh_;
    std::vector<Wedge> wedges_;
    double before_ = 1;  ///< least cosines
    double after_ = 1;
};

}  // namespace isonest::detail
