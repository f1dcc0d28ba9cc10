#include "query/simplify/collapse.h"

#include <algorithm>
#include <cmath>
#include <queue>

#include "query/simplify/quadric.h"

namespace isonest::detail {
namespace {

/// A triangle's normal may not turn further than to this cosine by one collapse.
constexpr double kLeastCosine = 0.1;
constexpr double kBorderWeight = 1;  ///< of the plane that stands on a border edge

struct Candidate {
    double square_error;
    std::uint32_t from;
    std::uint32_t to;
    std::uint32_t version;  ///< of `from`

    /// The queue's top is the smallest.
    bool operator<(const Candidate& other) const {
        return square_error != other.square_error ? square_error > other.square_error
               : from != other.from               ? from > other.from
                                                  : to > other.to;
    }
};

class Collapser {
  public:
    Collapser(const Patch& patch, std::span<const PatchTriangle> triangles,
              const std::vector<bool>& locked, double error)
        : patch_(patch),
          locked_(locked),
          square_error_(error * error),
          triangles_(triangles.begin(), triangles.end()),
          around_(patch.positions.size()),
          quadrics_(patch.positions.size()),
          version_(patch.positions.size()) {
        origin_ = patch.point(triangles.front()[0]);
        for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
            for (const std::uint32_t v : triangles_[i]) {
                around_[v].push_back(i);
            }
        }
        for (const PatchTriangle& t : triangles_) {
            add_quadrics(t);
        }
        for (std::uint32_t v = 0; v < around_.size(); ++v) {
            if (!locked_[v] && !around_[v].empty()) {
                push_all(v);
            }
        }
    }

    std::vector<PatchTriangle> run() {
        while (!queue_.empty()) {
            const Candidate next = queue_.top();
            queue_.pop();
            if (next.version == version_[next.from] && is_allowed(next.from, next.to)) {
                collapse(next.from, next.to);
            }
        }
        std::vector<PatchTriangle> left;
        for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
            const PatchTriangle& t = triangles_[i];
            if (t[0] != t[1]) {
                left.push_back(t);
            }
        }
        return left;
    }

  private:
    [[nodiscard]] Double3 at(std::uint32_t v) const { return minus(patch_.point(v), origin_); }
    [[nodiscard]] Double3 normal(const PatchTriangle& t) const {
        return cross(minus(at(t[1]), at(t[0])), minus(at(t[2]), at(t[0])));
    }
    static bool has(const PatchTriangle& t, std::uint32_t v) {
        return t[0] == v || t[1] == v || t[2] == v;
    }
    /// Triangles with both.
    [[nodiscard]] int shared_triangles(std::uint32_t a, std::uint32_t b) const {
        return static_cast<int>(
            std::count_if(around_[a].begin(), around_[a].end(),
                          [&](std::uint32_t i) { return has(triangles_[i], b); }));
    }
    void neighbours_of(std::uint32_t v, std::vector<std::uint32_t>& found) const {
        found.clear();
        for (const std::uint32_t i : around_[v]) {
            for (const std::uint32_t w : triangles_[i]) {
                if (w != v) {
                    found.push_back(w);
                }
            }
        }
        std::sort(found.begin(), found.end());
        found.erase(std::unique(found.begin(), found.end()), found.end());
    }

    void add_quadrics(const PatchTriangle& t) {
        Double3 n = normal(t);
        const double area = length(n);
        if (!(area > 0)) {
            return;
        }
        n = {n[0] / area, n[1] / area, n[2] / area};
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t a = t[i];
            const std::uint32_t b = t[(i + 1) % 3];
            quadrics_[a].add_plane(n, at(a), area);
            const Double3 edge = minus(at(b), at(a));
            if (shared_triangles(a, b) == 1 && square(edge) > 0) {
                const Double3 side = cross(edge, n);
                const double size = length(side);
                const Double3 upright{side[0] / size, side[1] / size, side[2] / size};
                quadrics_[a].add_plane(upright, at(a), kBorderWeight * square(edge));
                quadrics_[b].add_plane(upright, at(a), kBorderWeight * square(edge));
            }
        }
    }

    void push(std::uint32_t from, std::uint32_t to) {
        const double error = quadrics_[from].mean(at(to));
        if (error <= square_error_) {
            queue_.push({error, from, to, version_[from]});
        }
    }
    void push_all(std::uint32_t from) {
        neighbours_of(from, near_);
        for (const std::uint32_t to : near_) {
            push(from, to);
        }
    }

    /// Whether the surface stays the same but for its shape, and nothing turns over.
    bool is_allowed(std::uint32_t from, std::uint32_t to) {
        const int edge = shared_triangles(from, to);
        if (edge == 0) {
            return false;
        }
        neighbours_of(from, near_);
        neighbours_of(to, far_);
        common_.clear();
        std::set_intersection(near_.begin(), near_.end(), far_.begin(), far_.end(),
                              std::back_inserter(common_));
        const bool is_border = near_.size() != around_[from].size();
        if (static_cast<int>(common_.size()) != edge ||
            (is_border && (edge != 1 || !stays_in_face(from, to)))) {
            return false;
        }
        if (locked_[to] && std::any_of(near_.begin(), near_.end(), [&](std::uint32_t v) {
                return v != to && locked_[v] &&
                       !std::binary_search(common_.begin(), common_.end(), v);
            })) {
            return false;
        }
        return std::none_of(around_[from].begin(), around_[from].end(), [&](std::uint32_t i) {
            return !has(triangles_[i], to) && (turns(i, from, to) || is_double(i, from, to));
        });
    }
    /// Along which axes the two have the same coordinate, as bits.
    [[nodiscard]] unsigned same_axes(std::uint32_t a, std::uint32_t b) const {
        unsigned axes = 0;
        for (unsigned axis = 0; axis < 3; ++axis) {
            axes |= patch_.positions[a][axis] == patch_.positions[b][axis] ? 1U << axis : 0U;
        }
        return axes;
    }
    /// A border that lies in a face of the box, or of the volume, stays in it.
    [[nodiscard]] bool stays_in_face(std::uint32_t from, std::uint32_t to) const {
        const unsigned axes = same_axes(from, to);
        return std::all_of(near_.begin(), near_.end(), [&](std::uint32_t v) {
            if (v == to || shared_triangles(from, v) != 1) {
                return true;
            }
            const unsigned others = same_axes(from, v);
            return (axes & others) != 0 || (axes == 0 && others == 0);
        });
    }
    [[nodiscard]] bool turns(std::uint32_t i, std::uint32_t from, std::uint32_t to) const {
        const Double3 before = normal(triangles_[i]);
        const Double3 after = normal(moved(triangles_[i], from, to));
        const double size = square(after);
        return !(size > 0) || dot(before, after) < kLeastCosine * std::sqrt(size * square(before));
    }
    /// Whether there is a triangle with these corners already.
    [[nodiscard]] bool is_double(std::uint32_t i, std::uint32_t from, std::uint32_t to) const {
        const PatchTriangle next = moved(triangles_[i], from, to);
        return std::any_of(around_[to].begin(), around_[to].end(), [&](std::uint32_t other) {
            return std::all_of(next.begin(), next.end(),
                               [&](std::uint32_t v) { return has(triangles_[other], v); });
        });
    }
    static PatchTriangle moved(PatchTriangle t, std::uint32_t from, std::uint32_t to) {
        std::replace(t.begin(), t.end(), from, to);
        return t;
    }

    void collapse(std::uint32_t from, std::uint32_t to) {
        for (const std::uint32_t i : around_[from]) {
            PatchTriangle& t = triangles_[i];
            if (!has(t, to)) {
                t = moved(t, from, to);
                around_[to].push_back(i);
                continue;
            }
            for (const std::uint32_t v : t) {
                if (v != from) {
                    auto& of = around_[v];
                    of.erase(std::find(of.begin(), of.end(), i));
                }
            }
            t = {0, 0, 0};
        }
        around_[from].clear();
        around_[from].shrink_to_fit();
        ++version_[from];
        quadrics_[to].add(quadrics_[from]);
        ++version_[to];
        neighbours_of(to, far_);
        for (const std::uint32_t v : far_) {
            if (!locked_[v]) {
                push(v, to);
            }
            if (!locked_[to]) {
                push(to, v);
            }
        }
    }

    const Patch& patch_;
    const std::vector<bool>& locked_;
    double square_error_;
    Double3 origin_{};
    std::vector<PatchTriangle> triangles_;            ///< {0, 0, 0}: gone
    std::vector<std::vector<std::uint32_t>> around_;  ///< triangles of each vertex
    std::vector<Quadric> quadrics_;
    std::vector<std::uint32_t> version_;  ///< of the quadric
    std::priority_queue<Candidate> queue_;
    std::vector<std::uint32_t> near_;
    std::vector<std::uint32_t> far_;
    std::vector<std::uint32_t> common_;
};

}  // namespace

std::vector<PatchTriangle> collapse_edges(const Patch& patch,
                                          std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& locked, double error) {
    return triangles.empty() ? std::vector<PatchTriangle>{}
                             : Collapser(patch, triangles, locked, error).run();
}

}  // namespace isonest::detail
