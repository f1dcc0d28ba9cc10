#include "query/simplify/by_value/simplify_patch_by_value.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "query/simplify/collapse/collapse_stars.h"

namespace isonest::detail {
namespace {

class Simplifier {
  public:
    Simplifier(const Patch& patch, bool has_caps, ValueCover& cover)
        : patch_(patch),
          has_caps_(has_caps),
          cover_(cover),
          locked_(locked_vertices(patch)),
          mesh_(patch.positions.size(), patch.triangles, locked_),
          queue_(patch.positions, mesh_, std::numeric_limits<float>::max()),
          collapse_(patch.positions, patch.box, patch.shared, locked_, mesh_) {}

    ValuePatch run() {
        double largest = 0;
        collapse_stars(
            queue_, collapse_, waiting_vertices(patch_.triangles, patch_.tried, locked_), locked_,
            [this](const EdgeQueue::Edge& edge) { return fits(edge.from, edge.to) ? 0 : kNever; },
            [&] {
                largest = std::max(largest, met_);
                const std::uint32_t fewer = collapse_.fewer();
                collapse_.take();
                return fewer;
            });
        ValuePatch result;
        result.largest = largest;
        for (std::uint32_t i = 0; i < patch_.triangles.size(); ++i) {
            if (!mesh_.is_gone(i)) {
                const PatchTriangle t = mesh_.corners(i);
                result.triangles.push_back(from_smallest(t));
                result.tried.push_back(is_free(t, locked_));
            }
        }
        return result;
    }

  private:
    [[nodiscard]] bool is_cap(const PatchTriangle& t) const {
        return has_caps_ && (collapse_.faces_of(t[0]) & collapse_.faces_of(t[1]) &
                             collapse_.faces_of(t[2])) != 0;
    }
    bool covers(const PatchTriangle& t) {
        if (!cover_.covers(patch_.at(t))) {
            return false;
        }
        met_ = std::max(met_, cover_.largest());
        return true;
    }
    bool fits(std::uint32_t from, std::uint32_t to) {
        if (!collapse_.look(from, to) || !may_be_measured(collapse_)) {
            return false;
        }
        met_ = 0;
        const Star& star = collapse_.star();
        for (std::size_t j = 1; j + 1 < star.corners; ++j) {
            if (is_cap(mesh_.corners(collapse_.triangle(j)))) {
                continue;
            }
            const PatchTriangle after = collapse_.after(j);
            if (is_cap(after) || !covers(after)) {
                return false;
            }
        }
        return !has_caps_ || collapse_.faces_of(from) == 0 || rims_fit(from, to);
    }
    /// The lines between surface and caps that go out from `from` stay near, too.
    bool rims_fit(std::uint32_t from, std::uint32_t to) {
        const Star& star = collapse_.star();
        for (std::size_t i = 1; i < star.corners; ++i) {
            // Between old triangles i - 1 and i; no line goes to the corner that `from` becomes.
            if (i - 1 != star.missing && i != star.missing &&
                is_cap(mesh_.corners(collapse_.triangle(i - 1))) !=
                    is_cap(mesh_.corners(collapse_.triangle(i))) &&
                !covers({from, collapse_.vertex(i), to})) {
                return false;
            }
        }
        return true;
    }

    const Patch& patch_;
    bool has_caps_;
    ValueCover& cover_;
    std::vector<bool> locked_;
    CornerMesh mesh_;
    EdgeQueue queue_;
    StarCollapse collapse_;
    double met_ = 0;
};

}  // namespace

ValuePatch simplify_patch_by_value(const Patch& patch, bool has_caps, ValueCover& cover) {
    return Simplifier(patch, has_caps, cover).run();
}

}  // namespace isonest::detail
