#include "query/apart/keep_apart.h"

#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "query/mesh/nudge_vertex.h"
#include "query/mesh/vertex_stars.h"
#include "store/base/rotation.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

using Place = std::array<float, 3>;
constexpr int kMostRounds = 24;
constexpr std::uint64_t kOften = std::uint64_t{1} << 13U;

Double3 from_to(const Place& a, const Place& b) {
    Double3 d{};
    for (std::size_t i = 0; i < 3; ++i) {
        d[i] = static_cast<double>(b[i]) - static_cast<double>(a[i]);
    }
    return d;
}

/// Numbers decide only where normals do not, as they depend on the order of the mesh.
bool precedes_in_place(const PlacedVertex& a, const PlacedVertex& b) {
    return a.at != b.at             ? a.at < b.at
           : a.forward != b.forward ? a.forward < b.forward
                                    : a.number < b.number;
}

/// The directions to the neighbours of the middle in 3 * 3 * 3 places.
constexpr int kDirections = 26;
int component(int direction, int axis) {
    constexpr std::array<int, 3> kStride{1, 3, 9};
    const int place = direction < kDirections / 2 ? direction : direction + 1;
    return place / kStride.at(static_cast<std::size_t>(axis)) % 3 - 1;
}

class Apart {
  public:
    Apart(std::span<Place> positions, std::span<const ElementCorners> touched,
          std::span<PlacedVertex> vertices, const ApartRange& range, const ScratchFolder& folder,
          Progress& progress)
        : positions_(positions),
          touched_(touched),
          vertices_(vertices),
          range_(range),
          stars_(positions.size(), touched.size(), folder),
          progress_(progress) {}

    ApartVertices run() {
        ApartVertices result;
        if (!range_.moves) {
            each_place([&](std::span<PlacedVertex> some) { result.left += some.size(); });
            return result;
        }
        find_stars();
        each_place([&](std::span<PlacedVertex> some) {
            for (PlacedVertex& v : some) {
                v.forward = forward_of(v);
            }
            std::sort(some.begin(), some.end(), precedes_in_place);
        });
        for (int round = 0; round < kMostRounds; ++round) {
            each_place([&](std::span<PlacedVertex> some) { move_some(some, round); });
            result.left = sort_by_place(vertices_);
            if (result.left == 0) {
                break;
            }
        }
        for (const PlacedVertex& v : vertices_) {
            result.moved += v.now != v.start ? 1 : 0;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                result.by[axis] =
                    std::max(result.by[axis], std::fabs(from_to(v.start, v.now)[axis]));
            }
        }
        return result;
    }

  private:
    /// work(vertices) for each place with several. REQUIRES: sorted; `work` may move them.
    template <class Work>
    void each_place(const Work& work) {
        for (std::size_t begin = 0; begin < vertices_.size();) {
            std::size_t end = begin + 1;
            while (end < vertices_.size() && vertices_[end].at == vertices_[begin].at) {
                ++end;
            }
            if (end - begin > 1) {
                work(vertices_.subspan(begin, end - begin));
            }
            begin = end;
        }
    }

    void find_stars() {
        each_place([&](std::span<PlacedVertex> some) {
            for (const PlacedVertex& v : some) {
                stars_.mark(v.number);
            }
        });
        for (std::uint64_t t = 0; t < touched_.size(); ++t) {
            if (t % kOften == 0) {
                progress_.check();
                progress_.advance(std::min(kOften, touched_.size() - t));
            }
            for (std::size_t i = 0; i < 3; ++i) {
                stars_.add(3 * t + i, touched_[t][i]);
            }
        }
    }

    /// The sides opposite to a vertex, in its triangles.
    void find_sides(std::uint64_t v) {
        stars_.corners_of(v, around_);
        sides_.clear();
        for (const std::uint64_t corner : around_) {
            const ElementCorners& c = touched_[corner / 3];
            sides_.push_back({positions_[c[(corner + 1) % 3]], positions_[c[(corner + 2) % 3]]});
        }
    }

    [[nodiscard]] bool stays(const Place& at, std::size_t axis) const {
        return at[axis] == range_.low_faces[axis] || at[axis] == range_.high_faces[axis];
    }
    [[nodiscard]] double step(const Place& at, std::size_t axis) const {
        constexpr float kInfinity = std::numeric_limits<float>::infinity();
        const float size = std::fabs(at[axis]);
        const double unit = static_cast<double>(std::nextafter(size, kInfinity)) - size;
        return std::max(unit, range_.least_step[axis]);
    }

    /// The sum does not depend on the order of the triangles, since its terms are integers.
    Place forward_of(const PlacedVertex& v) {
        constexpr double kUnits = 1 << 24;
        find_sides(v.number);
        std::array<std::int64_t, 3> sum{};
        for (const OppositeSide& side : sides_) {
            const Double3 a = from_to(v.start, side[0]);
            const Double3 b = from_to(v.start, side[1]);
            const Double3 normal = cross(a, b);
            const double size = std::sqrt(dot(normal, normal));
            if (size > 0) {
                const double weight = std::atan2(size, dot(a, b)) / size * kUnits;
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    sum[axis] += std::llround(weight * normal[axis]);
                }
            }
        }
        Double3 n{};
        double most = 0;  // of the components, in steps
        for (std::size_t axis = 0; axis < 3; ++axis) {
            n[axis] = stays(v.start, axis) ? 0 : static_cast<double>(sum[axis]);
            most = std::max(most, std::fabs(n[axis]) / step(v.start, axis));
        }
        Place forward{};
        for (std::size_t axis = 0; axis < 3 && most > 0; ++axis) {
            forward[axis] = static_cast<float>(n[axis] / most);
        }
        return forward;
    }

    /// At the end of the mesh along an axis, where one has to stay so that it is the end.
    [[nodiscard]] bool is_at_end(const Place& at) const {
        bool at_end = false;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            at_end = at_end || at[axis] == range_.lo[axis] || at[axis] == range_.hi[axis];
        }
        return at_end;
    }

    /// In the first round all go one step. In the others those stay that have to, or the first.
    void move_some(std::span<PlacedVertex> some, int round) {
        const auto has_no_star = [&](const PlacedVertex& v) { return !stars_.is_marked(v.number); };
        const bool all_may_move = std::none_of(some.begin(), some.end(), has_no_star);
        int rank = all_may_move ? 0 : 1;
        std::size_t left = some.size();
        for (PlacedVertex& v : some) {
            if (has_no_star(v)) {
                continue;
            }
            if (round == 0) {
                if ((left > 1 || !is_at_end(v.now)) && try_steps(v, 1)) {
                    --left;
                }
            } else if (rank > 0 && !try_steps(v, rank + round)) {
                // At last what comes from several places has to part.
                constexpr std::uint64_t kPlaces = kDirections * kMostApart;
                const auto mixed = v.number * static_cast<std::uint64_t>(2 * round + 1);
                const int own = round < kMostRounds / 3 ? 0 : static_cast<int>(mixed % kPlaces);
                go_anywhere(v, rank + round + own);
            }
            ++rank;
        }
    }
    bool try_steps(PlacedVertex& v, int steps) {
        if (v.forward == Place{} || steps > kMostApart) {
            return false;
        }
        return try_move(v, {static_cast<double>(steps) * v.forward[0],
                            static_cast<double>(steps) * v.forward[1],
                            static_cast<double>(steps) * v.forward[2]});
    }
    /// Away from faces of the box only where nothing else helps, as in a corner of it.
    void go_anywhere(PlacedVertex& v, int number) {
        for (const bool on_faces : {true, false}) {
            for (int i = number; i < number + kDirections; ++i) {
                const int steps = 1 + i / kDirections % kMostApart;
                Double3 by{};
                for (int axis = 0; axis < 3; ++axis) {
                    const auto a = static_cast<std::size_t>(axis);
                    if (!on_faces || !stays(v.start, a)) {
                        by[a] = steps * component(i % kDirections, axis) * step(v.start, a);
                    }
                }
                if (by != Double3{} && try_move(v, by)) {
                    return;
                }
            }
        }
    }
    /// From where it was in the beginning; false if it would not leave its place.
    bool try_move(PlacedVertex& v, const Double3& by) {
        Place to{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            to[axis] = std::clamp(static_cast<float>(v.start[axis] + by[axis]), range_.lo[axis],
                                  range_.hi[axis]);
        }
        const Place at = range_.turn ? (*range_.turn)(to) : to;
        if (at == v.at) {
            return false;
        }
        find_sides(v.number);
        for (const OppositeSide& side : sides_) {
            if (missing_dimensions(to, side[0], side[1]) >
                missing_dimensions(v.now, side[0], side[1])) {
                return false;
            }
        }
        v.at = at;
        v.now = to;
        positions_[v.number] = to;
        return true;
    }

    std::span<Place> positions_;
    std::span<const ElementCorners> touched_;
    std::span<PlacedVertex> vertices_;
    const ApartRange& range_;
    VertexStars stars_;
    Progress& progress_;
    std::vector<std::uint64_t> around_;
    std::vector<OppositeSide> sides_;
};

}  // namespace

Place Turn::operator()(const Place& p) const {
    const Double3 turned = rotated_about(
        about, direction,
        {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
    return {static_cast<float>(turned[0]), static_cast<float>(turned[1]),
            static_cast<float>(turned[2])};
}

double Turn::least_step(const Int3& nodes, const Double3& spacing) const {
    Double3 diagonal{};
    double furthest = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        diagonal[axis] = spacing[axis] * static_cast<double>(nodes[static_cast<int>(axis)] - 1);
        furthest = std::max(furthest, std::fabs(about[axis]));
    }
    const auto largest = static_cast<float>(furthest + length(diagonal));
    // Of a vector of some length, a component has more than half of it.
    const double least =
        2 * (static_cast<double>(largest) - static_cast<double>(std::nextafter(largest, 0.0F)));
    return least / std::min({spacing[0], spacing[1], spacing[2]});
}

PlacedVertex placed_vertex(std::uint64_t number, const Place& at, const std::optional<Turn>& turn) {
    return {turn ? (*turn)(at) : at, at, at, {}, number};
}

std::uint64_t sort_by_place(std::span<PlacedVertex> vertices) {
    tbb::parallel_sort(vertices.begin(), vertices.end(), precedes_in_place);
    std::uint64_t together = 0;
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        const bool with_last = i > 0 && vertices[i - 1].at == vertices[i].at;
        const bool with_next = i + 1 < vertices.size() && vertices[i + 1].at == vertices[i].at;
        together += with_last || with_next ? 1 : 0;
    }
    return together;
}

ApartVertices keep_apart(std::span<Place> positions, std::span<const ElementCorners> touched,
                         std::span<PlacedVertex> vertices, const ApartRange& range,
                         const ScratchFolder& folder, Progress& progress) {
    progress.begin("keep sheets apart", touched.size(), "triangles");
    return Apart(positions, touched, vertices, range, folder, progress).run();
}

}  // namespace isonest::detail
