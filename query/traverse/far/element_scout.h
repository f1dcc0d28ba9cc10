// What AdaptTraverse reads of a store behind a network, for look_ahead().
#pragma once

#include <utility>
#include <vector>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/far/edge_needs.h"

namespace isonest::detail {

/// A scout of subtrees that are elements of kind 0. Leaves: what is wanted for a leaf, as
/// leaves(leaf, Wants&). Not thread-safe.
template <int D, class Numbers, class Region, class Interest, class Stop, class Leaves>
class ElementScout {
  public:
    /// `fields`: the store's, which the tests ask for. `leaves` may be null.
    ElementScout(const StoreLayout& layout, Numbers numbers, const Region& region,
                 const Interest& interest, const Stop& stop, std::vector<Field> fields,
                 Leaves leaves)
        : layout_(layout),
          numbers_(std::move(numbers)),
          traversal_(numbers_, region, interest, stop),
          fields_(std::move(fields)),
          leaves_(std::move(leaves)) {}
    ElementScout(const ElementScout&) = delete;
    ElementScout& operator=(const ElementScout&) = delete;

    void operator()(const Element<D>& subtree, const LookWalk& walk, Wants& wants) {
        auto leaf = [&](const Element<D>& t, double, Overlap) {
            if (walk.at_leaves) {
                leaves_(t, wants);
            }
        };
        left_.clear();
        if (walk.level < 0) {
            traversal_.subtree(subtree, leaf);
        } else {
            traversal_.above(subtree, walk.level, leaf, left_);
        }
        for (std::size_t i = 0; i < left_.size() && !walk.at_leaves; ++i) {
            want_below(left_[i], wants);
        }
    }

  private:
    /// The numbers between an element's level and the next.
    void want_below(const Element<D>& t, Wants& wants) {
        if (t.level == 0) {
            return;
        }
        const auto [low, high] = t.bounds();
        const auto at = [](const Int3& p, int level) {
            return Int3{p.x >> level, p.y >> level, p.z >> level};
        };
        const int finer = t.level - 1;
        wants.box(layout_.array(finer, Field::values), at(low, finer), at(high, finer));
        for (const Field field : fields_) {
            const ArrayInfo& array = layout_.array(t.level, field);
            wants.box(array, at(low, t.level), at(high, t.level));
            if (array.first_slot > 0) {
                // Those that are not stored follow from the values around them.
                wants.box(layout_.array(0, Field::values), low - Int3{1, 1, 1},
                          high + Int3{2, 2, 2});
            }
        }
    }

    const StoreLayout& layout_;
    Numbers numbers_;
    AdaptTraverse<D, Numbers, Region, Interest, Stop> traversal_;
    std::vector<Field> fields_;
    Leaves leaves_;
    std::vector<Element<D>> left_;
};

}  // namespace isonest::detail
