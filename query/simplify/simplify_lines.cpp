#include "query/simplify/simplify_lines.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace isonest::detail {
namespace {

/// Cones use this fraction of the limit, so that after rounding the results are still within the
/// limit; this is verified.
constexpr double kRounding = 1 - 1e-9;

double plane_cross(const PlanePoint& a, const PlanePoint& b) {
    return a[0] * b[1] - a[1] * b[0];
}
PlanePoint plane_vector(const PlanePoint& a, const PlanePoint& b) {
    return {a[0] - b[0], a[1] - b[1]};
}

/// The directions in which rays from a point come near all added points. Less than a half turn, as
/// soon as it is restricted.
class Cone {
  public:
    explicit Cone(double limit) : limit_(limit) {}

    [[nodiscard]] bool holds(const PlanePoint& direction) const {
        return all_ || (plane_cross(right_, direction) >= 0 && plane_cross(direction, left_) >= 0);
    }
    /// `to`: relative to the start of the rays. False if nothing is left.
    bool add(const PlanePoint& to) {
        const double square = to[0] * to[0] + to[1] * to[1];
        const double along = square - limit_ * limit_;
        if (!(along > 0)) {
            return true;
        }
        const double s = std::sqrt(along);
        Cone other(limit_);
        other.all_ = false;
        other.left_ = {to[0] * s - to[1] * limit_, to[0] * limit_ + to[1] * s};
        other.right_ = {to[0] * s + to[1] * limit_, to[1] * s - to[0] * limit_};
        if (all_) {
            *this = other;
            return true;
        }
        if (holds(other.right_)) {
            right_ = other.right_;
        } else if (!other.holds(right_)) {
            return false;
        }
        if (holds(other.left_)) {
            left_ = other.left_;
        } else if (!other.holds(left_)) {
            return false;
        }
        return true;
    }

  private:
    double limit_;
    bool all_ = true;
    PlanePoint left_{};
    PlanePoint right_{};
};

/// The point in between with the largest measure, except `but`; the first of several.
template <class Measure>
std::uint32_t furthest(std::span<const PlanePoint> points, std::uint32_t but,
                       const Measure& measure) {
    std::uint32_t best = 0;
    double most = -1;
    for (std::uint32_t i = 1; i + 1 < points.size(); ++i) {
        const double d = measure(points[i]);
        if (i != but && d > most) {
            most = d;
            best = i;
        }
    }
    return best;
}

}  // namespace

double square_distance_to_segment(const PlanePoint& p, const PlanePoint& a, const PlanePoint& b) {
    const PlanePoint ab = plane_vector(b, a);
    const PlanePoint ap = plane_vector(p, a);
    const double size = ab[0] * ab[0] + ab[1] * ab[1];
    const double t = size > 0 ? std::clamp((ap[0] * ab[0] + ap[1] * ab[1]) / size, 0.0, 1.0) : 0.0;
    const PlanePoint d = plane_vector(ap, {t * ab[0], t * ab[1]});
    return d[0] * d[0] + d[1] * d[1];
}

void FewestSegments::shortest_path(std::span<const PlanePoint> points, std::uint32_t first,
                                   double limit) {
    const auto n = static_cast<std::uint32_t>(points.size());
    const auto are_near = [&](std::uint32_t i, std::uint32_t j) {
        return std::all_of(points.begin() + i + 1, points.begin() + j, [&](const PlanePoint& p) {
            return square_distance_to_segment(p, points[i], points[j]) <= limit * limit;
        });
    };
    if (points.front() != points.back() && are_near(0, n - 1)) {
        kept_.push_back(first + n - 1);  // straight lines, for which the search takes longest
        return;
    }
    const std::size_t words = (points.size() + 63) / 64;
    near_.assign(words * n, 0);
    for (std::uint32_t i = 0; i + 1 < n; ++i) {
        Cone cone(limit * kRounding);
        for (std::uint32_t j = i + 1; j < n; ++j) {
            const PlanePoint to = plane_vector(points[j], points[i]);
            if (!cone.add(to)) {
                break;
            }
            if (cone.holds(to)) {
                near_[i * words + j / 64] |= std::uint64_t{1} << (j % 64);
            }
        }
    }
    hops_.assign(n, 0);
    before_.assign(n, 0);
    for (std::uint32_t j = 1; j < n; ++j) {
        hops_[j] = hops_[j - 1] + 1;
        before_[j] = j - 1;
        Cone cone(limit * kRounding);
        for (std::uint32_t i = j; i-- > 0;) {
            const PlanePoint to = plane_vector(points[i], points[j]);
            if (!cone.add(to)) {
                break;
            }
            const auto from_other_end = [&] {
                return (near_[i * words + j / 64] >> (j % 64) & 1U) != 0;
            };
            if (hops_[i] + 1 < hops_[j] && cone.holds(to) && from_other_end() &&
                points[i] != points[j]) {
                hops_[j] = hops_[i] + 1;
                before_[j] = i;
            }
        }
    }
    const std::size_t begin = kept_.size();
    for (std::uint32_t j = n - 1; j > 0;) {
        const std::uint32_t i = before_[j];
        kept_.push_back(first + j);
        j = are_near(i, j) ? i : j - 1;
    }
    std::reverse(kept_.begin() + static_cast<std::ptrdiff_t>(begin), kept_.end());
}

void FewestSegments::with_min(std::span<const PlanePoint> points, double limit,
                              std::uint32_t least) {
    std::vector<std::uint32_t> ends{0, static_cast<std::uint32_t>(points.size() - 1)};
    const PlanePoint& a = points.front();
    const std::uint32_t far = furthest(points, 0, [&](const PlanePoint& p) {
        return square_distance_to_segment(p, a, points.back());
    });
    ends.push_back(far);
    if (least == 3) {
        // For a loop: the point that gives the largest triangle with the first two corners.
        ends.push_back(furthest(points, far, [&](const PlanePoint& p) {
            return std::fabs(plane_cross(plane_vector(points[far], a), plane_vector(p, a)));
        }));
    }
    std::sort(ends.begin(), ends.end());
    kept_.assign(1, 0);
    for (std::size_t e = 1; e < ends.size(); ++e) {
        shortest_path(points.subspan(ends[e - 1], ends[e] - ends[e - 1] + 1), ends[e - 1], limit);
    }
}

std::span<const std::uint32_t> FewestSegments::find(std::span<const PlanePoint> points,
                                                    double limit, std::uint32_t least) {
    if (points.size() <= std::size_t{least} + 1) {
        kept_.resize(points.size());
        for (std::uint32_t i = 0; i < kept_.size(); ++i) {
            kept_[i] = i;
        }
        return kept_;
    }
    kept_.assign(1, 0);
    shortest_path(points, 0, limit);
    bool is_enough = kept_.size() > least;
    if (least == 3 && kept_.size() == 4) {
        const PlanePoint& a = points[kept_[0]];
        is_enough =
            plane_cross(plane_vector(points[kept_[1]], a), plane_vector(points[kept_[2]], a)) != 0;
    }
    if (!is_enough) {
        with_min(points, limit, least);
    }
    return kept_;
}

namespace {

constexpr std::uint64_t kMany = std::numeric_limits<std::uint64_t>::max();
constexpr std::uint64_t kCheckEvery = std::uint64_t{1} << 14U;

/// The segments at each vertex, and which of them are in a chain.
class Adjacency {
  public:
    Adjacency(const ScratchMesh& mesh, const CornerView& segments, const ScratchFolder& folder,
              Progress& progress)
        : corners_(segments), at_file_(folder), taken_file_(folder) {
        at_file_.map(mesh.layout().vertices * sizeof(Two));
        taken_file_.map(corners_.size());
        at_ = at_file_.as<Two>();
        taken_ = taken_file_.as<std::uint8_t>();
        for (std::uint64_t s = 0; s < corners_.size(); ++s) {
            if (s % kCheckEvery == 0) {
                progress.check();
            }
            for (std::size_t end = 0; end < 2; ++end) {
                Two& two = at_[corners_[s][end]];
                if (two[0] == 0) {
                    two[0] = s + 1;
                } else {
                    two[1] = two[1] == 0 ? s + 1 : kMany;
                }
            }
        }
    }
    [[nodiscard]] bool is_passed(std::uint64_t vertex) const {
        return at_[vertex][1] != 0 && at_[vertex][1] != kMany;
    }
    /// Whether the vertex has one segment.
    [[nodiscard]] bool is_open(std::uint64_t vertex) const { return at_[vertex][1] == 0; }
    /// The other segment of a vertex with two.
    [[nodiscard]] std::uint64_t other(std::uint64_t vertex, std::uint64_t segment) const {
        const Two& two = at_[vertex];
        return (two[0] == segment + 1 ? two[1] : two[0]) - 1;
    }
    [[nodiscard]] bool is_taken(std::uint64_t segment) const { return taken_[segment] != 0; }
    void take(std::uint64_t segment) { taken_[segment] = 1; }

  private:
    /// Numbers of segments, counted from 1; 0 = none. The second is kMany if there are more.
    using Two = std::array<std::uint64_t, 2>;
    CornerView corners_;
    ScratchFile at_file_;
    ScratchFile taken_file_;
    std::span<Two> at_;
    std::span<std::uint8_t> taken_;
};

std::uint32_t min_of(const Adjacency& adjacency, std::uint64_t from, std::uint64_t to,
                     std::uint64_t segments) {
    std::uint64_t least = 1;
    if (from == to) {
        least = 3;
    } else if (!adjacency.is_open(from) && !adjacency.is_open(to)) {
        least = 2;
    }
    return static_cast<std::uint32_t>(std::min(least, segments));
}

}  // namespace

LineChains::LineChains(const ScratchMesh& mesh, const CornerView& segments,
                       const ScratchFolder& folder, Progress& progress)
    : chains_(folder), vertices_(folder) {
    Adjacency adjacency(mesh, segments, folder, progress);
    const auto corners = segments;
    // Follows a chain from `from` along `segment`, to a vertex without further unused segments.
    const auto follow = [&](std::uint64_t from, std::uint64_t segment) {
        Chain chain;
        chain.first = vertices_.size();
        std::uint64_t at = from;
        while (true) {
            if (vertices_.size() % kCheckEvery == 0) {
                progress.check();
            }
            vertices_.append(at);
            adjacency.take(segment);
            at = corners[segment][corners[segment][0] == at ? 1 : 0];
            if (!adjacency.is_passed(at)) {
                vertices_.append(at);
                chain.vertices = vertices_.size() - chain.first;
                chain.least = min_of(adjacency, from, at, chain.segments());
                break;
            }
            segment = adjacency.other(at, segment);
            if (adjacency.is_taken(segment)) {
                chain.closed = 1;
                chain.vertices = vertices_.size() - chain.first;
                chain.least =
                    static_cast<std::uint32_t>(std::min<std::uint64_t>(chain.vertices, 3));
                break;
            }
        }
        chains_.append(chain);
    };
    for (std::uint64_t s = 0; s < corners.size(); ++s) {
        for (std::size_t end = 0; end < 2; ++end) {
            if (!adjacency.is_taken(s) && !adjacency.is_passed(corners[s][end])) {
                follow(corners[s][end], s);
            }
        }
    }
    for (std::uint64_t s = 0; s < corners.size(); ++s) {
        if (!adjacency.is_taken(s)) {
            follow(corners[s][0], s);
        }
    }
    chains_.seal();
    vertices_.seal();
}

namespace {

/// Maximum number of segments in a run.
constexpr std::uint64_t kRun = 1024;
/// Minimum number of runs of a chain that does not fit into one run. Each run keeps a segment, and
/// so does each part across a border, so a loop keeps three.
constexpr std::uint64_t kFewestRuns = 3;
/// Number of segments of the result on either side of a border that are processed again.
constexpr std::size_t kAround = 8;
/// Maximum number of segments of the mesh that the final merging tries to replace by one; it limits
/// the time on straight lines.
constexpr std::uint64_t kMaxReplaced = 16 * kRun;

/// Part of a chain with fixed ends.
struct Run {
    std::uint64_t chain = 0;
    std::uint64_t number = 0;  ///< among the runs of the chain
};

std::uint64_t runs_of(const Chain& chain) {
    const std::uint64_t segments = chain.segments();
    return segments <= kRun ? 1 : std::max((segments + kRun - 1) / kRun, kFewestRuns);
}
/// Where a run starts.
std::uint64_t border(const Chain& chain, std::uint64_t number) {
    const std::uint64_t runs = runs_of(chain);
    const std::uint64_t whole = chain.segments() / runs;
    const std::uint64_t rest = chain.segments() % runs;
    return number * whole + number * rest / runs;
}

/// State of one thread.
struct Worker {
    std::vector<PlanePoint> points;
    FewestSegments fewest;
};

/// Determines which vertices of the chains are kept.
class Simplifier {
  public:
    Simplifier(const ScratchMesh& mesh, const LineChains& lines, int flat_axis, double limit,
               const ScratchFolder& folder)
        : positions_(mesh.positions()),
          chains_(lines.chains()),
          vertices_(lines.vertices()),
          limit_(limit),
          axes_{flat_axis == 0 ? 1U : 0U, flat_axis == 2 ? 1U : 2U},
          kept_file_(folder),
          runs_(folder),
          long_chains_(folder) {
        kept_file_.map(vertices_.size());
        kept_ = kept_file_.as<std::uint8_t>();
        for (std::uint64_t c = 0; c < chains_.size(); ++c) {
            const Chain& chain = chains_[c];
            const std::uint64_t runs = runs_of(chain);
            for (std::uint64_t r = 0; r < runs; ++r) {
                runs_.append({c, r});
                kept_[chain.place(border(chain, r))] = 1;
            }
            if (chain.closed == 0) {
                kept_[chain.place(chain.segments())] = 1;
            }
            if (runs > 1) {
                long_chains_.append(c);
            }
        }
        runs_.seal();
        long_chains_.seal();
    }

    void simplify_runs(Progress& progress) {
        for_each(runs_.all(), progress, [&](const Run& run, Worker& worker) {
            const Chain& chain = chains_[run.chain];
            const std::uint64_t from = border(chain, run.number);
            const std::uint64_t to = border(chain, run.number + 1);
            progress.advance(to - from);
            const bool is_whole = runs_of(chain) == 1;
            const auto places = fewest(chain, from, to, is_whole ? chain.least : 1, worker);
            keep_inside(chain, from, places);
            if (is_whole && chain.closed != 0 && places.size() > std::size_t{chain.least} + 1) {
                simplify_start(chain, places, worker);
            }
        });
    }

    /// Simplifies again around the borders.
    void simplify_borders(Progress& progress) {
        for_each(runs_.all(), progress, [&](const Run& run, Worker& worker) {
            const Chain& chain = chains_[run.chain];
            const std::uint64_t runs = runs_of(chain);
            if (runs > 1 && (run.number > 0 || chain.closed != 0)) {
                simplify_around(chain,
                                border(chain, run.number) + (run.number == 0 ? chain.vertices : 0),
                                chain.segments() / runs / 2, worker);
            }
        });
    }

    /// Drops kept vertices, one at a time, if the chain stays within the limit.
    void merge(Progress& progress) {
        for_each(long_chains_.all(), progress, [&](std::uint64_t c, Worker& /*worker*/) {
            const Chain& chain = chains_[c];
            std::uint64_t left = kept_in(chain) - 1 + chain.closed;
            std::uint64_t from = 0;
            while (!is_kept(chain, from)) {
                ++from;
            }
            const std::uint64_t end = from + chain.segments();
            std::uint64_t middle = next_kept(chain, from);
            while (middle < end && left > chain.least) {
                const std::uint64_t to = next_kept(chain, middle);
                if (to - from <= kMaxReplaced && can_drop(chain, from, middle, to)) {
                    kept_[chain.place(middle)] = 0;
                    --left;
                } else {
                    from = middle;
                }
                middle = to;
            }
        });
    }

    /// Calls use(v, w, distance) for each segment of the result, in order.
    template <class Use>
    void each_segment(Progress& progress, const Use& use) const {
        for (const Chain& chain : chains_) {
            std::uint64_t from = 0;
            while (!is_kept(chain, from)) {
                ++from;
            }
            const std::uint64_t end = from + chain.segments();
            while (from < end) {
                progress.check();
                const std::uint64_t to = next_kept(chain, from);
                double most = 0;
                for (std::uint64_t i = from + 1; i < to; ++i) {
                    most =
                        std::max(most, square_distance_to_segment(
                                           point(chain, i), point(chain, from), point(chain, to)));
                }
                use(vertices_[chain.place(from)], vertices_[chain.place(to)], std::sqrt(most));
                from = to;
            }
        }
    }

  private:
    template <class Item, class Work>
    void for_each(std::span<Item> items, Progress& progress, const Work& work) {
        tbb::parallel_for(std::size_t{0}, items.size(), [&](std::size_t i) {
            progress.check();
            work(items[i], workers_.local());
        });
    }

    [[nodiscard]] PlanePoint point(const Chain& chain, std::uint64_t i) const {
        const auto& p = positions_[vertices_[chain.place(i)]];
        return {static_cast<double>(p[axes_[0]]), static_cast<double>(p[axes_[1]])};
    }
    [[nodiscard]] bool is_kept(const Chain& chain, std::uint64_t i) const {
        return kept_[chain.place(i)] != 0;
    }
    /// REQUIRES: there is a kept vertex behind `i`.
    [[nodiscard]] std::uint64_t next_kept(const Chain& chain, std::uint64_t i) const {
        do {
            ++i;
        } while (!is_kept(chain, i));
        return i;
    }
    [[nodiscard]] std::uint64_t kept_in(const Chain& chain) const {
        const auto kept = kept_.subspan(chain.first, chain.vertices);
        return static_cast<std::uint64_t>(std::count(kept.begin(), kept.end(), 1));
    }

    /// From vertex `from` of the chain to vertex `to`, as indices relative to `from`.
    std::span<const std::uint32_t> fewest(const Chain& chain, std::uint64_t from, std::uint64_t to,
                                          std::uint32_t least, Worker& worker) const {
        worker.points.clear();
        for (std::uint64_t i = from; i <= to; ++i) {
            worker.points.push_back(point(chain, i));
        }
        return worker.fewest.find(worker.points, limit_, least);
    }
    /// Without the ends, which other runs may read.
    void keep_inside(const Chain& chain, std::uint64_t from,
                     std::span<const std::uint32_t> places) {
        for (const std::uint32_t place : places.subspan(1, places.size() - 2)) {
            kept_[chain.place(from + place)] = 1;
        }
    }

    /// Simplifies again between two kept vertices, kAround segments before and behind `middle`, but
    /// at most `most` vertices away.
    void simplify_around(const Chain& chain, std::uint64_t middle, std::uint64_t most,
                         Worker& worker) {
        std::uint64_t from = middle;
        std::uint64_t to = middle;
        std::size_t before = 0;
        for (std::uint64_t i = 1, n = 0; i <= most && n < kAround; ++i) {
            if (is_kept(chain, middle - i)) {
                from = middle - i;
                ++n;
                ++before;
            }
        }
        for (std::uint64_t i = 1, n = 0; i <= most && n < kAround; ++i) {
            if (is_kept(chain, middle + i)) {
                to = middle + i;
                ++n;
                ++before;
            }
        }
        if (from == middle || to == middle) {
            return;
        }
        const auto places = fewest(chain, from, to, 1, worker);
        if (places.size() - 1 < before) {
            for (std::uint64_t i = from + 1; i < to; ++i) {
                kept_[chain.place(i)] = 0;
            }
            keep_inside(chain, from, places);
        }
    }

    /// For a loop that is one run. `places`: of the kept vertices; the first and the last are the
    /// start.
    void simplify_start(const Chain& chain, std::span<const std::uint32_t> places, Worker& worker) {
        const std::size_t before = places.size();
        if (before > 2 * kAround + chain.least) {
            simplify_around(chain, chain.vertices, chain.vertices / 2, worker);
            return;
        }
        const std::uint64_t other = places[before / 2];
        const auto better = fewest(chain, other, other + chain.vertices, chain.least, worker);
        if (better.size() < before) {
            const auto kept = kept_.subspan(chain.first, chain.vertices);
            std::fill(kept.begin(), kept.end(), std::uint8_t{0});
            kept[other] = 1;
            keep_inside(chain, other, better);
        }
    }

    /// Whether vertex `middle`, which is kept, and all others in between are near the segment.
    [[nodiscard]] bool can_drop(const Chain& chain, std::uint64_t from, std::uint64_t middle,
                                std::uint64_t to) const {
        const PlanePoint a = point(chain, from);
        const PlanePoint b = point(chain, to);
        const auto is_near = [&](std::uint64_t i) {
            return square_distance_to_segment(point(chain, i), a, b) <= limit_ * limit_;
        };
        if (a == b || !is_near(middle)) {
            return false;
        }
        for (std::uint64_t i = from + 1; i < to; ++i) {
            if (!is_near(i)) {
                return false;
            }
        }
        return true;
    }

    std::span<const std::array<float, 3>> positions_;
    std::span<const Chain> chains_;
    std::span<const std::uint64_t> vertices_;
    double limit_;
    std::array<std::size_t, 2> axes_;
    ScratchFile kept_file_;  ///< for each vertex of the chains whether it is kept
    std::span<std::uint8_t> kept_;
    GrowingFile<Run> runs_;
    GrowingFile<std::uint64_t> long_chains_;  ///< those with several runs
    tbb::enumerable_thread_specific<Worker> workers_;
};

}  // namespace

std::uint64_t simplify_lines_heap() {
    // Bits of FewestSegments; points, places, paths, and data waiting to be written to files.
    return (kRun + 1) * (kRun + 64) / 8 + 512 * kRun;
}

SimplifiedLines::SimplifiedLines(const ScratchMesh& mesh, const CornerView& segments, int flat_axis,
                                 double limit, const ScratchFolder& folder, Progress& progress)
    : corners_(folder) {
    progress.begin("simplify", segments.size(), "line segments");
    const LineChains lines(mesh, segments, folder, progress);
    Simplifier simplifier(mesh, lines, flat_axis, limit, folder);
    simplifier.simplify_runs(progress);
    simplifier.simplify_borders(progress);
    simplifier.merge(progress);
    simplifier.each_segment(progress, [&](std::uint64_t v, std::uint64_t w, double distance) {
        corners_.append({v, w, w});
        bound_ = std::max(bound_, distance);
    });
    corners_.seal();
}

}  // namespace isonest::detail
