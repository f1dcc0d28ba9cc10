#include "query/apart/keep_apart.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "query/mesh/mend_triangles.h"
#include "query/mesh/vertex_stars.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

/// Marks a vertex that also belongs to an earlier part.
constexpr std::uint64_t kOfOther = std::numeric_limits<std::uint64_t>::max();

}  // namespace

PlacedVertices::PlacedVertices(const PartStore& parts, const VertexNumbers& weld,
                               const std::optional<Rotation>& rotation, const ScratchFolder& folder,
                               Progress& progress)
    : file_(folder) {
    const auto records = parts.records();
    if (!records.empty()) {
        count_ = records.back().first_not_alone + records.back().not_alone;
    }
    if (count_ == 0) {
        return;
    }
    file_.map(count_ * sizeof(PlacedVertex));
    const auto all = this->all();
    tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        const PartRecord& r = records[i];
        if (r.not_alone == 0) {
            return;
        }
        progress.check();
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        weld.numbers(r, number, owned);
        const auto positions = parts.vertices(r);
        std::uint64_t at = r.first_not_alone;
        for (const std::uint32_t v : parts.not_alone(r)) {
            all[at++] = placed_vertex(owned[v] ? number[v] : kOfOther, positions[v], rotation);
        }
    });
    const auto end = std::remove_if(all.begin(), all.end(),
                                    [](const PlacedVertex& v) { return v.number == kOfOther; });
    count_ = static_cast<std::uint64_t>(end - all.begin());
}

PlacedVertices::PlacedVertices(std::span<const std::array<float, 3>> positions,
                               std::span<const std::uint32_t> numbers, const ScratchFolder& folder)
    : file_(folder), count_(numbers.size()) {
    file_.map(count_ * sizeof(PlacedVertex));
    std::transform(numbers.begin(), numbers.end(), all().begin(),
                   [&](std::uint32_t v) { return placed_vertex(v, positions[v]); });
}

PlacedVertices::PlacedVertices(const ScratchMesh& mesh, const std::optional<Rotation>& rotation,
                               const ScratchFolder& folder)
    : file_(folder), count_(mesh.positions().size()) {
    file_.map(count_ * sizeof(PlacedVertex));
    const auto all = this->all();
    for (std::uint64_t v = 0; v < count_; ++v) {
        all[v] = placed_vertex(v, mesh.positions()[v], rotation);
    }
}

TouchedTriangles::TouchedTriangles(std::span<const PlacedVertex> vertices,
                                   std::uint64_t mesh_vertices, const ScratchFolder& folder)
    : bit_file_(folder), triangle_file_(folder) {
    bit_file_.map((mesh_vertices / kBits + 1) * sizeof(std::uint64_t));
    bits_ = bit_file_.as<std::uint64_t>();
    const auto mark = [&](const PlacedVertex& v) {
        bits_[v.number / kBits] |= std::uint64_t{1} << (v.number % kBits);
    };
    for (std::size_t i = 1; i < vertices.size(); ++i) {
        if (vertices[i - 1].at == vertices[i].at) {
            mark(vertices[i - 1]);
            mark(vertices[i]);
        }
    }
}

void TouchedTriangles::add(std::span<const ElementCorners> triangles) {
    if (!triangles.empty()) {
        triangle_file_.write_at(count_ * sizeof(ElementCorners), std::as_bytes(triangles));
        count_ += triangles.size();
    }
}

std::span<const ElementCorners> TouchedTriangles::all() {
    if (count_ == 0) {
        return {};
    }
    triangle_file_.map(count_ * sizeof(ElementCorners));
    return triangle_file_.as<const ElementCorners>().first(count_);
}

namespace {

using Place = std::array<float, 3>;
constexpr int kMaxRounds = 24;
constexpr std::uint64_t kOften = std::uint64_t{1} << 13U;

Double3 from_to(const Place& a, const Place& b) {
    Double3 d{};
    for (std::size_t i = 0; i < 3; ++i) {
        d[i] = static_cast<double>(b[i]) - static_cast<double>(a[i]);
    }
    return d;
}

/// Numbers are used only if normals are equal, because they depend on the order of the mesh.
bool precedes_in_place(const PlacedVertex& a, const PlacedVertex& b) {
    return a.at != b.at             ? a.at < b.at
           : a.forward != b.forward ? a.forward < b.forward
                                    : a.number < b.number;
}

/// The directions to the neighbours of the centre in a 3 * 3 * 3 grid.
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
        for (int round = 0; round < kMaxRounds; ++round) {
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
    /// Calls work(vertices) for each place with several vertices. REQUIRES: sorted; `work` may move
    /// them.
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

    /// Finds the sides opposite a vertex, in its triangles.
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
        return std::max(unit, range_.min_step[axis]);
    }

    /// The sum does not depend on the order of the triangles, because its terms are integers.
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
        double most = 0;  // maximum component, in steps
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

    /// Whether the position is at the end of the mesh along an axis, where one vertex must stay to
    /// preserve the extent.
    [[nodiscard]] bool is_at_end(const Place& at) const {
        bool at_end = false;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            at_end = at_end || at[axis] == range_.lo[axis] || at[axis] == range_.hi[axis];
        }
        return at_end;
    }

    /// In the first round all vertices move one step. In later rounds those that must stay do,
    /// otherwise the first.
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
                // In the last rounds, vertices that came from several places must be separated.
                constexpr std::uint64_t kPlaces = kDirections * kMaxApart;
                const auto mixed = v.number * static_cast<std::uint64_t>(2 * round + 1);
                const int own = round < kMaxRounds / 3 ? 0 : static_cast<int>(mixed % kPlaces);
                go_anywhere(v, rank + round + own);
            }
            ++rank;
        }
    }
    bool try_steps(PlacedVertex& v, int steps) {
        if (v.forward == Place{} || steps > kMaxApart) {
            return false;
        }
        return try_move(v, {static_cast<double>(steps) * v.forward[0],
                            static_cast<double>(steps) * v.forward[1],
                            static_cast<double>(steps) * v.forward[2]});
    }
    /// Moves away from faces of the box only if nothing else helps, as in a corner of the box.
    void go_anywhere(PlacedVertex& v, int number) {
        for (const bool on_faces : {true, false}) {
            for (int i = number; i < number + kDirections; ++i) {
                const int steps = 1 + i / kDirections % kMaxApart;
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
    /// Moves from the initial position; returns false if the vertex would not leave its place.
    bool try_move(PlacedVertex& v, const Double3& by) {
        Place to{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            to[axis] = std::clamp(static_cast<float>(v.start[axis] + by[axis]), range_.lo[axis],
                                  range_.hi[axis]);
        }
        const Place at = range_.rotation ? (*range_.rotation)(to) : to;
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

Place Rotation::operator()(const Place& p) const {
    const Double3 turned = rotated_about(
        about, direction,
        {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
    return {static_cast<float>(turned[0]), static_cast<float>(turned[1]),
            static_cast<float>(turned[2])};
}

double Rotation::min_step(const Int3& nodes, const LatticeSteps& steps) const {
    Double3 diagonal{};
    double furthest = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        diagonal[axis] = static_cast<double>(nodes[static_cast<int>(axis)] - 1);
        furthest = std::max(furthest, std::fabs(about[axis]));
    }
    const auto largest = static_cast<float>(furthest + length(steps.vector(diagonal)));
    // A vector has a component with more than half of its length.
    const double least =
        2 * (static_cast<double>(largest) - static_cast<double>(std::nextafter(largest, 0.0F)));
    const Double3 shortest = steps.min_along();
    return least / std::min({shortest[0], shortest[1], shortest[2]});
}

PlacedVertex placed_vertex(std::uint64_t number, const Place& at,
                           const std::optional<Rotation>& rotation) {
    return {rotation ? (*rotation)(at) : at, at, at, {}, number};
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

namespace {

constexpr auto kPrecedesByNumber = [](const PlacedVertex& a, const PlacedVertex& b) {
    return a.number < b.number;
};

}  // namespace

TouchedInPart touched_in(const PartStore& parts, const PartRecord& r, const VertexNumbers& weld,
                         const std::function<bool(std::uint64_t)>& touches) {
    TouchedInPart found;
    if (r.not_alone == 0) {
        return found;
    }
    std::vector<std::uint64_t> number;
    std::vector<bool> owned;
    weld.numbers(r, number, owned);
    std::vector<bool> touched(r.vertices);
    bool any = false;
    for (const std::uint32_t v : parts.not_alone(r)) {
        touched[v] = touches(number[v]);
        any = any || touched[v];
    }
    if (!any) {
        return found;
    }
    const auto positions = parts.vertices(r);
    for (const auto& t : parts.triangles(r)) {
        if (touched[t[0]] || touched[t[1]] || touched[t[2]]) {
            found.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
            found.at.push_back({positions[t[0]], positions[t[1]], positions[t[2]]});
        }
    }
    return found;
}

void put_back(PartStore& parts, const VertexNumbers& weld, std::span<PlacedVertex> vertices) {
    tbb::parallel_sort(vertices.begin(), vertices.end(), kPrecedesByNumber);
    const auto records = parts.records();
    tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        const PartRecord& r = records[i];
        if (r.not_alone == 0) {
            return;
        }
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        weld.numbers(r, number, owned);
        const auto positions = parts.changeable_vertices(r);
        for (const std::uint32_t v : parts.not_alone(r)) {
            PlacedVertex sought;
            sought.number = number[v];
            const auto found =
                std::lower_bound(vertices.begin(), vertices.end(), sought, kPrecedesByNumber);
            if (found != vertices.end() && found->number == number[v] &&
                found->now != found->start) {
                positions[v] = found->now;
            }
        }
    });
}

ApartVertices keep_parts_apart(PartStore& parts, const VertexNumbers& weld, ApartRange range,
                               const ScratchFolder& folder, Progress& progress) {
    const PlacedVertices placed(parts, weld, range.rotation, folder, progress);
    if (sort_by_place(placed.all()) == 0) {
        return {};
    }
    ScratchFile position_file(folder);
    position_file.map(weld.vertices() * sizeof(std::array<float, 3>));
    const auto positions = position_file.as<std::array<float, 3>>();
    TouchedTriangles touched(placed.all(), weld.vertices(), folder);
    touched.gather(
        parts.records().size(),
        [&](std::size_t i) {
            progress.check();
            return touched_in(parts, parts.records()[i], weld,
                              [&](std::uint64_t v) { return touched.touches(v); });
        },
        [&](const TouchedInPart& some) {
            for (std::size_t t = 0; t < some.triangles.size(); ++t) {
                for (std::size_t i = 0; i < 3; ++i) {
                    positions[some.triangles[t][i]] = some.at[t][i];
                }
            }
        });
    range.lo = parts.lo();
    range.hi = parts.hi();
    const ApartVertices apart =
        keep_apart(positions, touched.all(), placed.all(), range, folder, progress);
    if (apart.moved > 0) {
        put_back(parts, weld, placed.all());
    }
    return apart;
}

}  // namespace isonest::detail
