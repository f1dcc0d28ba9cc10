#include "query/simplify/by_value/simplify_patch_by_value.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "query/simplify/collapse/collapse_edges.h"

namespace isonest::detail {
namespace {

class Simplifier {
  public:
    Simplifier(const Patch& patch, bool has_caps, ValueCover& cover, std::vector<bool> locked)
        : patch_(patch),
          has_caps_(has_caps),
          cover_(cover),
          locked_(std::move(locked)),
          mesh_(patch, locked_),
          order_(patch, mesh_, locked_, std::numeric_limits<double>::infinity()) {}
    Simplifier(const Simplifier&) = delete;
    Simplifier& operator=(const Simplifier&) = delete;

    void run() {
        collapse_edges(
            patch_, locked_, mesh_, order_,
            [this](std::uint32_t from, std::uint32_t to) { return fits(from, to); },
            [this] { largest_ = std::max(largest_, met_); });
    }
    [[nodiscard]] std::vector<PatchTriangle> triangles() const { return triangles_left(mesh_); }
    [[nodiscard]] ValuePatch result() const {
        ValuePatch result;
        result.triangles = triangles();
        result.largest = largest_;
        std::transform(result.triangles.begin(), result.triangles.end(),
                       std::back_inserter(result.tried), [&](const PatchTriangle& t) {
                           return std::none_of(t.begin(), t.end(),
                                               [&](std::uint32_t v) { return locked_[v]; });
                       });
        return result;
    }

  private:
    [[nodiscard]] bool is_cap(const PatchTriangle& t) const {
        return has_caps_ &&
               (mesh_.faces_of(t[0]) & mesh_.faces_of(t[1]) & mesh_.faces_of(t[2])) != 0;
    }
    bool covers(const PatchTriangle& t) {
        if (!cover_.covers(patch_.at(t))) {
            return false;
        }
        met_ = std::max(met_, cover_.largest());
        return true;
    }
    /// The line between surface and cap goes from `from` to each of these.
    void find_rims(std::uint32_t from) {
        rims_.clear();
        for (const std::uint32_t i : mesh_.around(from)) {
            const PatchTriangle& t = mesh_.triangles()[i];
            for (const std::uint32_t v : t) {
                if (v == from || is_cap(t)) {
                    continue;
                }
                const auto& around = mesh_.around(v);
                const bool at_cap =
                    std::any_of(around.begin(), around.end(), [&](std::uint32_t other) {
                        const PatchTriangle& o = mesh_.triangles()[other];
                        return CollapsingPatch::has(o, from) && is_cap(o);
                    });
                if (at_cap) {
                    rims_.push_back(v);
                }
            }
        }
    }
    bool fits(std::uint32_t from, std::uint32_t to) {
        met_ = 0;
        const auto& around = mesh_.around(from);
        const bool all_fit = std::all_of(around.begin(), around.end(), [&](std::uint32_t i) {
            const PatchTriangle& t = mesh_.triangles()[i];
            if (CollapsingPatch::has(t, to) || is_cap(t)) {
                return true;
            }
            const PatchTriangle next = CollapsingPatch::moved(t, from, to);
            return !is_cap(next) && covers(next);
        });
        if (!all_fit || !has_caps_ || mesh_.faces_of(from) == 0) {
            return all_fit;
        }
        find_rims(from);
        return std::all_of(rims_.begin(), rims_.end(), [&](std::uint32_t v) {
            return v == to || covers({from, v, to});
        });
    }

    const Patch& patch_;
    bool has_caps_;
    ValueCover& cover_;
    std::vector<bool> locked_;
    CollapsingPatch mesh_;
    CollapseOrder order_;
    std::vector<std::uint32_t> rims_;
    double met_ = 0;
    double largest_ = 0;
};

}  // namespace

ValuePatch simplify_patch_by_value(const Patch& patch, bool has_caps, ValueCover& cover) {
    return with_same_topology(patch, [&](const std::vector<bool>& locked) {
        return Simplifier(patch, has_caps, cover, locked);
    });
}

}  // namespace isonest::detail
