#include "query/mesh/mend_triangles.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <type_traits>
#include <utility>
#include <vector>

#include "query/mesh/vertex_stars.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

Double3 normal_of(const Point& a, const OppositeSide& side) {
    const auto from_a = [&a](const Point& p) {
        Double3 d{};
        for (std::size_t i = 0; i < 3; ++i) {
            d[i] = static_cast<double>(p[i]) - static_cast<double>(a[i]);
        }
        return d;
    };
    return cross(from_a(side[0]), from_a(side[1]));
}

/// The triangles' normals before the move.
std::vector<Double3> facings(const Point& vertex, std::span<const OppositeSide> around) {
    std::vector<Double3> normals;
    normals.reserve(around.size());
    Double3 sum{};
    for (const OppositeSide& side : around) {
        normals.push_back(normal_of(vertex, side));
        for (std::size_t i = 0; i < 3; ++i) {
            sum[i] += normals.back()[i];
        }
    }
    for (std::size_t i = 0; i < around.size(); ++i) {
        if (missing_dimensions(vertex, around[i][0], around[i][1]) > 0) {
            normals[i] = sum;
        }
    }
    return normals;
}

float stepped(float from, double least, int steps) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    const float size = std::fabs(from);
    const double unit = static_cast<double>(std::nextafter(size, kInfinity)) - size;
    return static_cast<float>(from + steps * std::max(unit, least));
}

double square_height(const Point& a, const OppositeSide& side, const Double3& normal) {
    double longest = 0;
    for (const auto& [p, q] :
         {std::pair{a, side[0]}, std::pair{a, side[1]}, std::pair{side[0], side[1]}}) {
        double square = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            const double d = static_cast<double>(q[i]) - static_cast<double>(p[i]);
            square += d * d;
        }
        longest = std::max(longest, square);
    }
    return longest > 0 ? dot(normal, normal) / longest : 0;
}

/// The effect of moving the vertex to `to`; nothing if no dimension is gained, or a triangle loses
/// one. `missing`, `facing`: of the triangles before.
std::optional<Nudge> tried(const Point& to, std::span<const OppositeSide> around,
                           const std::vector<int>& missing, const std::vector<Double3>& facing) {
    Nudge next{to, 0, 0, std::numeric_limits<double>::infinity()};
    for (std::size_t i = 0; i < around.size(); ++i) {
        const int left = missing_dimensions(to, around[i][0], around[i][1]);
        if (left > missing[i]) {
            return {};
        }
        next.mended += missing[i] - left;
        const Double3 normal = normal_of(to, around[i]);
        next.turned += dot(normal, facing[i]) < 0 ? 1 : 0;
        if (left == 0) {
            next.square_height = std::min(next.square_height, square_height(to, around[i], normal));
        }
    }
    return next.mended > 0 ? std::optional(next) : std::nullopt;
}

bool is_better(const Nudge& a, const Nudge& b) {
    return a.turned != b.turned   ? a.turned < b.turned
           : a.mended != b.mended ? a.mended > b.mended
                                  : a.square_height > b.square_height;
}

}  // namespace

int missing_dimensions(const Point& a, const Point& b, const Point& c) {
    return !has_no_area(a, b, c) ? 0 : a == b && b == c ? 2 : 1;
}

std::optional<Nudge> nudged(const Point& vertex, std::span<const OppositeSide> around,
                            const NudgeRange& range, int steps, NudgeFreedom freedom) {
    const std::vector<Double3> facing = facings(vertex, around);
    std::vector<int> missing(around.size());
    std::transform(around.begin(), around.end(), missing.begin(), [&](const OppositeSide& side) {
        return missing_dimensions(vertex, side[0], side[1]);
    });
    std::array<std::vector<float>, 3> places;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float at = vertex[axis];
        const bool on_face = at == range.lo[axis] || at == range.hi[axis];
        for (int s = -steps; s <= steps; ++s) {
            float to = stepped(at, range.min_step[axis], s);
            if (freedom == NudgeFreedom::stay_on_faces && on_face) {
                to = at;
            } else if (freedom != NudgeFreedom::anywhere) {
                to = std::clamp(to, range.lo[axis], range.hi[axis]);
            }
            places[axis].push_back(to);
        }
    }
    std::optional<Nudge> best;
    const auto count = static_cast<std::size_t>(2 * steps + 1);
    const auto is_end = [&](std::size_t i) { return i == 0 || i + 1 == count; };
    for (std::size_t z = 0; z < count; ++z) {
        for (std::size_t y = 0; y < count; ++y) {
            for (std::size_t x = 0; x < count; ++x) {
                if (!is_end(x) && !is_end(y) && !is_end(z)) {
                    continue;
                }
                const std::optional<Nudge> next =
                    tried({places[0][x], places[1][y], places[2][z]}, around, missing, facing);
                if (next && (!best || is_better(*next, *best))) {
                    best = next;
                }
            }
        }
    }
    return best;
}

namespace {

constexpr std::uint64_t kNone = ScratchMesh::kNoVertex;
constexpr std::uint64_t kCheckEvery = std::uint64_t{1} << 13U;

/// The position of a vertex before it was moved.
struct Start {
    Point position;
    std::uint32_t was_moved;
};

/// Vertices with more triangles are not changed, which limits the work per vertex.
constexpr std::size_t kMaxAround = std::size_t{1} << 12U;
constexpr int kMaxSteps = 4;  ///< maximum length of a move, along an axis

/// A queue of triangles, each at most once, first in first out.
class Waiting {
  public:
    Waiting(std::uint64_t triangles, const ScratchFolder& folder) : file_(folder) {
        file_.map(triangles * sizeof(std::uint64_t));
        next_ = file_.as<std::uint64_t>();
    }
    void push(std::uint64_t t) {
        if (next_[t] != 0) {
            return;
        }
        next_[t] = kLast;
        if (first_ == kNone) {
            first_ = t;
        } else {
            next_[last_] = t + kFirst;
        }
        last_ = t;
    }
    [[nodiscard]] bool empty() const { return first_ == kNone; }
    std::uint64_t pop() {
        const std::uint64_t t = first_;
        first_ = next_[t] == kLast ? kNone : next_[t] - kFirst;
        next_[t] = 0;
        return t;
    }

  private:
    static constexpr std::uint64_t kLast = 1;   ///< 0: not in the queue
    static constexpr std::uint64_t kFirst = 2;  ///< stands for triangle 0
    ScratchFile file_;
    std::span<std::uint64_t> next_;
    std::uint64_t first_ = kNone;
    std::uint64_t last_ = 0;
};

/// Corners of triangles in memory, with the interface of CornerFile.
class CornersInMemory {
  public:
    explicit CornersInMemory(std::span<std::array<std::uint32_t, 3>> triangles)
        : triangles_(triangles) {}
    [[nodiscard]] std::uint64_t size() const { return triangles_.size(); }
    [[nodiscard]] std::uint64_t at(std::uint64_t t, std::size_t i) const {
        const std::uint32_t v = triangles_[t][i];
        return v == kNoTriangle ? kNone : v;
    }
    [[nodiscard]] ElementCorners operator[](std::uint64_t t) const {
        return {at(t, 0), at(t, 1), at(t, 2)};
    }
    void set(std::uint64_t t, std::size_t i, std::uint64_t v) const {
        triangles_[t][i] = static_cast<std::uint32_t>(v);
    }
    void set(std::uint64_t t, const ElementCorners& corners) const {
        for (std::size_t i = 0; i < corners.size(); ++i) {
            set(t, i, corners[i]);
        }
    }

  private:
    std::span<std::array<std::uint32_t, 3>> triangles_;
};

/// `Corners`: CornerFile or CornersInMemory.
template <class Corners>
class Mender {
  public:
    Mender(std::span<Point> positions, Corners& corners, const NudgeRange& range,
           const ScratchFolder& folder, Progress& progress)
        : positions_(positions),
          corners_(corners),
          stars_(positions_.size(), corners_.size(), folder),
          waiting_(corners_.size(), folder),
          start_file_(folder),
          range_(range),
          progress_(progress) {
        start_file_.map(positions_.size() * sizeof(Start));
        std::atomic<std::uint64_t> found = 0;
        each_at_once([&](std::uint64_t t) { return lacks_area(t); },
                     [&](std::uint64_t /*t*/) { ++found; });
        result_.found = found;
        if (result_.found < corners_.size() / kFew) {
            suspects_.emplace();
        }
        in_order([&](std::uint64_t t) { return lacks_area(t); },
                 [&](std::uint64_t t) {
                     suspect(t);
                     waiting_.push(t);
                     for (const std::uint64_t v : corners_[t]) {
                         stars_.mark(v);
                     }
                 });
        in_order(
            [&](std::uint64_t t) {
                const ElementCorners c = corners_[t];
                return is_there(t) &&
                       (stars_.is_marked(c[0]) || stars_.is_marked(c[1]) || stars_.is_marked(c[2]));
            },
            [&](std::uint64_t t) {
                for (std::size_t i = 0; i < 3; ++i) {
                    stars_.add(3 * t + i, corners_.at(t, i));
                }
            });
    }

    MendedTriangles run() {
        while (mend_in_place() > 0) {
            each([&](std::uint64_t t) { look_again_at(t); });
        }
        each([&](std::uint64_t t) {
            while (lacks_area(t) && move_one_of(t)) {
                mend_in_place();
            }
        });
        each([&](std::uint64_t t) { result_.left += lacks_area(t) ? 1 : 0; });
        return result_;
    }
    /// Vertices that were moved; some occur several times.
    [[nodiscard]] const std::vector<std::uint64_t>& moved() const { return moved_; }

  private:
    /// Suspects are recorded if at most one in this many triangles is one: the record stays small
    /// compared to the mesh.
    static constexpr std::uint64_t kFew = 1024;

    /// Records that `t` may lack area, or gain it.
    void suspect(std::uint64_t t) {
        if (suspects_) {
            suspects_->insert(t);
        }
    }
    /// Calls work(t), from any thread, for the triangles with is_one(t).
    template <class IsOne, class Work>
    void each_at_once(const IsOne& is_one, const Work& work) const {
        constexpr std::uint64_t kAtOnce = std::uint64_t{1} << 16U;
        tbb::parallel_for(std::uint64_t{0}, (corners_.size() + kAtOnce - 1) / kAtOnce,
                          [&](std::uint64_t piece) {
                              progress_.check();
                              const std::uint64_t first = piece * kAtOnce;
                              const std::uint64_t end = std::min(first + kAtOnce, corners_.size());
                              for (std::uint64_t t = first; t < end; ++t) {
                                  if (is_one(t)) {
                                      work(t);
                                  }
                              }
                          });
    }
    /// The same in ascending order, from this thread; all is_one() calls come before any work.
    template <class IsOne, class Work>
    void in_order(const IsOne& is_one, const Work& work) {
        if (!suspects_) {
            each([&](std::uint64_t t) {
                if (is_one(t)) {
                    work(t);
                }
            });
            return;
        }
        std::vector<std::uint64_t> found;
        std::mutex mutex;
        each_at_once(is_one, [&](std::uint64_t t) {
            const std::lock_guard lock(mutex);
            found.push_back(t);
        });
        std::sort(found.begin(), found.end());
        std::for_each(found.begin(), found.end(), work);
        progress_.advance(corners_.size());
    }
    /// Processes all triangles that may lack area; work() may add suspects.
    template <class Work>
    void each(const Work& work) {
        if (suspects_) {
            for (auto t = suspects_->begin(); t != suspects_->end(); ++t) {
                work(*t);
            }
            progress_.check();
            progress_.advance(corners_.size());
            return;
        }
        for (std::uint64_t t = 0; t < corners_.size(); ++t) {
            if (t % kCheckEvery == 0) {
                progress_.check();
                progress_.advance(std::min<std::uint64_t>(kCheckEvery, corners_.size() - t));
            }
            work(t);
        }
    }
    [[nodiscard]] bool is_there(std::uint64_t t) const { return corners_.at(t, 0) != kNone; }
    [[nodiscard]] bool lacks_area(const ElementCorners& c) const {
        return has_no_area(positions_[c[0]], positions_[c[1]], positions_[c[2]]);
    }
    [[nodiscard]] bool lacks_area(std::uint64_t t) const {
        return is_there(t) && lacks_area(corners_[t]);
    }
    [[nodiscard]] bool has(std::uint64_t t, std::uint64_t v) const {
        return corners_.at(t, 0) == v || corners_.at(t, 1) == v || corners_.at(t, 2) == v;
    }
    /// The vertex at the corner, or at a following corner of its triangle.
    [[nodiscard]] std::uint64_t vertex_of(std::uint64_t corner, std::uint64_t after = 0) const {
        return corners_.at(corner / 3, (corner % 3 + after) % 3);
    }

    /// Returns false if the link is not a single ring.
    bool link_of(std::uint64_t v, LinkEdges& link) {
        stars_.corners_of(v, around_);
        if (around_.size() > kMaxAround) {
            return false;
        }
        link.clear();
        for (const std::uint64_t corner : around_) {
            link.push_back({vertex_of(corner, 1), vertex_of(corner, 2)});
        }
        return close_link(link);
    }

    void look_again_at(std::uint64_t t) {
        if (lacks_area(t)) {
            waiting_.push(t);
        }
    }
    /// Requeues triangles around a changed vertex, because they may now be repairable.
    void look_again_around(std::uint64_t v) {
        if (!stars_.is_marked(v)) {
            return;
        }
        stars_.corners_of(v, around_);
        for (const std::uint64_t corner : around_) {
            suspect(corner / 3);
            look_again_at(corner / 3);
        }
    }

    void drop(std::uint64_t t) {
        for (std::size_t i = 0; i < 3; ++i) {
            stars_.remove(3 * t + i, corners_.at(t, i));
        }
        corners_.set(t, {kNone, kNone, kNone});
    }

    void rename(std::uint64_t corner, std::uint64_t to) {
        suspect(corner / 3);
        stars_.remove(corner, vertex_of(corner));
        corners_.set(corner / 3, corner % 3, to);
        stars_.add(corner, to);
    }

    /// Processes the queue, without moving vertices. Returns the number of successes.
    std::uint64_t mend_in_place() {
        std::uint64_t mended = 0;
        while (!waiting_.empty()) {
            const std::uint64_t t = waiting_.pop();
            if (!lacks_area(t)) {
                continue;
            }
            const ElementCorners c = corners_[t];
            if (!collapsed(t) && !flipped(t)) {
                continue;
            }
            ++mended;
            progress_.check();
            for (const std::uint64_t v : c) {
                look_again_around(v);
            }
        }
        return mended;
    }

    bool collapsed(std::uint64_t t) {
        const ElementCorners c = corners_[t];
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint64_t kept = std::min(c[i], c[(i + 1) % 3]);
            const std::uint64_t gone = std::max(c[i], c[(i + 1) % 3]);
            if (positions_[kept] == positions_[gone] && link_of(kept, link_) &&
                link_of(gone, other_link_) && may_collapse(link_, other_link_)) {
                collapse(gone, kept);
                return true;
            }
        }
        return false;
    }

    void collapse(std::uint64_t gone, std::uint64_t kept) {
        stars_.corners_of(gone, around_);
        for (const std::uint64_t corner : around_) {
            if (has(corner / 3, kept)) {
                drop(corner / 3);
            }
        }
        stars_.corners_of(gone, around_);
        stars_.remove_all(gone);
        for (const std::uint64_t corner : around_) {
            suspect(corner / 3);
            corners_.set(corner / 3, corner % 3, kept);
            stars_.add(corner, kept);
        }
    }

    /// The corner between the other two of a triangle that is a segment; kNone if two are equal.
    [[nodiscard]] std::uint64_t middle_of(std::uint64_t t) const {
        const ElementCorners c = corners_[t];
        std::array<double, 3> side{};  // opposite to each corner
        for (std::size_t i = 0; i < 3; ++i) {
            const Point& a = positions_[c[(i + 1) % 3]];
            const Point& b = positions_[c[(i + 2) % 3]];
            if (a == b) {
                return kNone;
            }
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double d = static_cast<double>(b[axis]) - static_cast<double>(a[axis]);
                side[i] += d * d;
            }
        }
        const auto longest = std::max_element(side.begin(), side.end());
        return 3 * t + static_cast<std::uint64_t>(longest - side.begin());
    }

    /// Also true if the longest side was a border and the triangle was removed.
    bool flipped(std::uint64_t t) {
        const std::uint64_t corner = middle_of(t);
        if (corner == kNone) {
            return false;
        }
        const std::uint64_t middle = vertex_of(corner);
        const std::uint64_t a = vertex_of(corner, 1);
        const std::uint64_t b = vertex_of(corner, 2);
        stars_.corners_of(a, around_);
        std::uint64_t across = kNone;  // the neighbour's corner opposite the side
        std::size_t at_side = 0;
        for (const std::uint64_t at_a : around_) {
            at_side += has(at_a / 3, b) ? 1 : 0;
            if (at_a / 3 != t && vertex_of(at_a, 2) == b) {
                across = at_a / 3 * 3 + (at_a + 1) % 3;
            }
        }
        if (at_side == 1) {
            if (!link_of(middle, link_) || link_.back()[0] == kBeyondBorder) {
                return false;
            }
            drop(t);
            return true;
        }
        return at_side == 2 && across != kNone && side_flipped(corner, across);
    }

    bool side_flipped(std::uint64_t corner, std::uint64_t across) {
        const std::uint64_t middle = vertex_of(corner);
        const std::uint64_t a = vertex_of(corner, 1);
        const std::uint64_t b = vertex_of(corner, 2);
        const std::uint64_t d = vertex_of(across);
        stars_.corners_of(middle, around_);
        const bool is_edge = std::any_of(around_.begin(), around_.end(),
                                         [&](std::uint64_t other) { return has(other / 3, d); });
        if (is_edge || lacks_area(ElementCorners{middle, a, d}) ||
            lacks_area(ElementCorners{middle, d, b})) {
            return false;
        }
        const auto place = [](std::uint64_t of, std::uint64_t after) {
            return of / 3 * 3 + (of + after) % 3;
        };
        rename(place(corner, 2), d);       // (middle, a, b) to (middle, a, d)
        rename(place(across, 2), middle);  // (d, b, a) to (d, b, middle)
        return true;
    }

    /// Moves the corner of `t` that turns the fewest triangles, by as few steps as possible.
    bool move_one_of(std::uint64_t t) {
        for (const NudgeFreedom freedom :
             {NudgeFreedom::stay_on_faces, NudgeFreedom::stay_in_box, NudgeFreedom::anywhere}) {
            std::optional<Nudge> best;
            std::uint64_t moved = kNone;
            for (int steps = 1; steps <= kMaxSteps && (!best || best->turned > 0); ++steps) {
                for (const std::uint64_t v : corners_[t]) {
                    const std::optional<Nudge> next = nudge_of(v, steps, freedom);
                    if (next && (!best || next->turned < best->turned)) {
                        best = next;
                        moved = v;
                    }
                }
            }
            if (best) {
                move(moved, best->to);
                return true;
            }
        }
        return false;
    }

    std::optional<Nudge> nudge_of(std::uint64_t v, int steps, NudgeFreedom freedom) {
        stars_.corners_of(v, around_);
        if (around_.size() > kMaxAround) {
            return {};
        }
        std::vector<OppositeSide> sides;
        sides.reserve(around_.size());
        for (const std::uint64_t corner : around_) {
            sides.push_back({positions_[vertex_of(corner, 1)], positions_[vertex_of(corner, 2)]});
        }
        return nudged(positions_[v], sides, range_, steps, freedom);
    }

    void move(std::uint64_t v, const Point& to) {
        Start& start = start_file_.as<Start>()[v];
        if (start.was_moved == 0) {
            start = {positions_[v], 1};
            ++result_.moved_vertices;
            if constexpr (std::is_same_v<Corners, CornersInMemory>) {
                moved_.push_back(v);
            }
        }
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double by =
                static_cast<double>(to[axis]) - static_cast<double>(start.position[axis]);
            result_.moved[axis] = std::max(result_.moved[axis], std::fabs(by));
        }
        positions_[v] = to;
        look_again_around(v);
    }

    std::span<Point> positions_;
    Corners& corners_;
    VertexStars stars_;
    Waiting waiting_;
    ScratchFile start_file_;
    NudgeRange range_;
    Progress& progress_;
    MendedTriangles result_;
    LinkEdges link_;
    LinkEdges other_link_;
    std::vector<std::uint64_t> around_;
    std::optional<std::set<std::uint64_t>> suspects_;  ///< nothing: all triangles
    std::vector<std::uint64_t> moved_;
};

void begin(Progress& progress, std::uint64_t triangles) {
    constexpr std::uint64_t kPasses = 4;
    progress.begin("mend triangles", kPasses * triangles, "triangles");
}

}  // namespace

MendedTriangles mend_triangles(ScratchMesh& mesh, const Double3& min_step,
                               const ScratchFolder& folder, Progress& progress) {
    begin(progress, mesh.layout().elements);
    const MendedTriangles result =
        Mender(mesh.changeable_positions(), mesh.changeable_corners(),
               {min_step, mesh.layout().lo, mesh.layout().hi}, folder, progress)
            .run();
    mesh.compact(folder, progress);
    return result;
}

MendedTriangles mend_triangles(std::span<std::array<float, 3>> positions,
                               std::span<std::array<std::uint32_t, 3>> triangles,
                               const std::array<float, 3>& lo, const std::array<float, 3>& hi,
                               const Double3& min_step, std::vector<std::uint32_t>& moved_vertices,
                               const ScratchFolder& folder, Progress& progress) {
    begin(progress, triangles.size());
    CornersInMemory corners(triangles);
    Mender mender(positions, corners, NudgeRange{min_step, lo, hi}, folder, progress);
    const MendedTriangles result = mender.run();
    moved_vertices.clear();
    for (const std::uint64_t v : mender.moved()) {
        moved_vertices.push_back(static_cast<std::uint32_t>(v));
    }
    return result;
}

}  // namespace isonest::detail
