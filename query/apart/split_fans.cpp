#include "query/apart/split_fans.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <vector>

#include "query/mesh/vertex_stars.h"
#include "store/base/box.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kLookEvery = std::uint64_t{1} << 13U;
constexpr std::size_t kCopiesAtOnce = std::size_t{1} << 13U;

/// Corners at one vertex, grouped into fans.
class FansOfVertex {
  public:
    explicit FansOfVertex(const CornerFile& corners) : corners_(corners) {}

    /// Afterwards fan_of() gives the fan of each element of `at`. Returns the number of fans; they
    /// are numbered in the order of `at`.
    std::size_t sort(std::span<const std::uint64_t> at) {
        starts_.clear();
        for (std::size_t i = 0; i < at.size(); ++i) {
            starts_.push_back({neighbour(at[i], 1), i});
        }
        std::sort(starts_.begin(), starts_.end());
        parent_.resize(at.size());
        std::iota(parent_.begin(), parent_.end(), std::size_t{0});
        const std::span parent(parent_);
        for (std::size_t i = 0; i < at.size(); ++i) {
            const std::uint64_t end = neighbour(at[i], 2);
            const auto next = std::lower_bound(starts_.begin(), starts_.end(), Start{end, 0});
            if (next != starts_.end() && next->neighbour == end) {
                unite(parent, i, next->place);
            }
        }
        std::size_t count = 0;
        fan_.resize(at.size());
        for (std::size_t i = 0; i < at.size(); ++i) {
            const std::size_t root = root_of(parent, i);
            fan_[i] = root == i ? count++ : fan_[root];
        }
        return count;
    }
    [[nodiscard]] std::size_t fan_of(std::size_t place) const { return fan_[place]; }

  private:
    struct Start {
        std::uint64_t neighbour;
        std::size_t place;
        auto operator<=>(const Start&) const = default;
    };
    [[nodiscard]] std::uint64_t neighbour(std::uint64_t corner, std::uint64_t after) const {
        return corners_.at(corner / 3, (corner % 3 + after) % 3);
    }

    const CornerFile& corners_;
    std::vector<Start> starts_;
    std::vector<std::size_t> parent_;  ///< for unite()
    std::vector<std::size_t> fan_;
};

}  // namespace

std::uint64_t split_fans(ScratchMesh& mesh, const BoxFaces& faces, const ScratchFolder& folder,
                         Progress& progress) {
    const std::uint64_t vertices = mesh.layout().vertices;
    CornerFile& corners = mesh.changeable_corners();
    const std::uint64_t triangles = corners.size();
    progress.begin("split fans", vertices + triangles, "triangles and vertices");
    VertexStars stars(vertices, triangles, folder);
    for (std::uint64_t v = 0; v < vertices; ++v) {
        if (faces.faces_of(mesh.positions()[v]) != 0) {
            stars.mark(v);
        }
    }
    for (std::uint64_t t = 0; t < triangles; ++t) {
        if (t % kLookEvery == 0) {
            progress.check();
            progress.advance(std::min(kLookEvery, triangles - t));
        }
        for (std::uint64_t i = 0; i < 3; ++i) {
            stars.add(3 * t + i, corners.at(t, i));
        }
    }
    FansOfVertex fans(corners);
    std::vector<ScratchMesh::MovedCopy> copies;
    std::uint64_t split = 0;
    std::vector<std::uint64_t> around;
    for (std::uint64_t v = 0; v < vertices; ++v) {
        if (v % kLookEvery == 0) {
            progress.check();
            progress.advance(std::min(kLookEvery, vertices - v));
        }
        if (!stars.is_marked(v)) {
            continue;
        }
        stars.corners_of(v, around);
        std::reverse(around.begin(), around.end());
        const std::size_t count = fans.sort(around);
        if (count < 2) {
            continue;
        }
        const std::uint64_t next = vertices + split;
        split += count - 1;
        copies.insert(copies.end(), count - 1, {mesh.positions()[v], v});
        for (std::size_t i = 0; i < around.size(); ++i) {
            if (fans.fan_of(i) > 0) {
                corners.set(around[i] / 3, around[i] % 3, next + fans.fan_of(i) - 1);
            }
        }
        if (copies.size() >= kCopiesAtOnce) {
            mesh.add_copies(copies);
            copies.clear();
        }
    }
    mesh.add_copies(copies);
    return split;
}

}  // namespace isonest::detail
