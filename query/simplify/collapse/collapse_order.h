// Which edge of a patch is collapsed next: the one by which the surface changes least.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997. What the quadrics estimate is an order and no promise.
#pragma once

#include <cstdint>
#include <optional>
#include <queue>
#include <vector>

#include "query/simplify/collapse/collapsing_patch.h"
#include "query/simplify/collapse/quadric.h"

namespace isonest::detail {

struct Collapse {
    float square_error = 0;  ///< world units
    std::uint32_t from = 0;
    std::uint32_t to = 0;
    std::uint32_t state = 0;

    Collapse(float error, std::uint32_t start, std::uint32_t end, std::uint32_t version,
             bool has_others)
        : square_error(error), from(start), to(end), state(2 * version + (has_others ? 1U : 0U)) {}
    /// Of the quadric of `from`.
    [[nodiscard]] std::uint32_t version() const { return state / 2; }
    /// Edges from `from` that have not been queued.
    [[nodiscard]] bool has_others() const { return state % 2 != 0; }

    /// A queue's top is the smallest.
    bool operator<(const Collapse& other) const {
        return square_error != other.square_error ? square_error > other.square_error
               : from != other.from               ? from > other.from
                                                  : to > other.to;
    }
};

/// Not thread-safe.
class CollapseOrder {
  public:
    /// Edges whose error is larger than `error` (world units) never come. All three arguments have
    /// to stay.
    CollapseOrder(const Patch& patch, const CollapsingPatch& mesh, const std::vector<bool>& locked,
                  double error);

    /// From now on the edges from `v` are waiting.
    void add(std::uint32_t v);
    /// Nothing: none waits.
    std::optional<Collapse> next();
    /// `from` was collapsed into `to`; the edges there wait again.
    void collapsed(std::uint32_t from, std::uint32_t to);

  private:
    [[nodiscard]] Double3 at(std::uint32_t v) const { return minus(patch_.point(v), origin_); }
    void add_quadrics(const PatchTriangle& t);
    void push(std::uint32_t from, std::uint32_t to);
    [[nodiscard]] float square_error(std::uint32_t from, std::uint32_t to) const;
    void push_next(std::uint32_t from, float after, std::uint32_t after_to);

    const Patch& patch_;
    const CollapsingPatch& mesh_;
    const std::vector<bool>& locked_;
    float most_;  ///< square error
    Double3 origin_{};
    std::vector<Quadric> quadrics_;
    std::vector<std::uint32_t> version_;
    std::priority_queue<Collapse> queue_;
    std::vector<std::uint32_t> near_;
};

}  // namespace isonest::detail
