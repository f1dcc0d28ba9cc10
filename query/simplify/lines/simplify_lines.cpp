#include "query/simplify/lines/simplify_lines.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "query/simplify/lines/fewest_segments.h"
#include "query/simplify/lines/line_chains.h"

namespace isonest::detail {
namespace {

/// Segments in a run, at most.
constexpr std::uint64_t kRun = 1024;
/// A chain that does not fit into one run is cut into at least so many. Each keeps a segment, and
/// so does each part across a border, so that a loop keeps three.
constexpr std::uint64_t kFewestRuns = 3;
/// Segments of the result on either side of a border that are looked at once more.
constexpr std::size_t kAround = 8;
/// Segments of the mesh that one segment is tried to replace in the end, at most: what bounds the
/// time on straight lines.
constexpr std::uint64_t kMostReplaced = 16 * kRun;

/// Part of a chain with fixed ends.
struct Run {
    std::uint64_t chain = 0;
    std::uint64_t number = 0;  ///< among the runs of the chain
};

std::uint64_t runs_of(const Chain& chain) {
    const std::uint64_t segments = chain.segments();
    return segments <= kRun ? 1 : std::max((segments + kRun - 1) / kRun, kFewestRuns);
}
/// Where a run begins.
std::uint64_t border(const Chain& chain, std::uint64_t number) {
    const std::uint64_t runs = runs_of(chain);
    const std::uint64_t whole = chain.segments() / runs;
    const std::uint64_t rest = chain.segments() % runs;
    return number * whole + number * rest / runs;
}

/// What one thread works with.
struct Worker {
    std::vector<PlanePoint> points;
    FewestSegments fewest;
};

/// Which vertices of the chains stay.
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

    /// Around the borders.
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

    /// Drops vertices that stayed, one at a time, where that leaves the chain within the limit.
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
                if (to - from <= kMostReplaced && can_drop(chain, from, middle, to)) {
                    kept_[chain.place(middle)] = 0;
                    --left;
                } else {
                    from = middle;
                }
                middle = to;
            }
        });
    }

    /// Calls use(v, w, distance) for each segment of the result in order.
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
    /// REQUIRES: there is one behind `i`.
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

    /// From vertex `from` of the chain to vertex `to`, as places behind `from`.
    std::span<const std::uint32_t> fewest(const Chain& chain, std::uint64_t from, std::uint64_t to,
                                          std::uint32_t least, Worker& worker) const {
        worker.points.clear();
        for (std::uint64_t i = from; i <= to; ++i) {
            worker.points.push_back(point(chain, i));
        }
        return worker.fewest.find(worker.points, limit_, least);
    }
    /// But for the ends: other runs may look at them.
    void keep_inside(const Chain& chain, std::uint64_t from,
                     std::span<const std::uint32_t> places) {
        for (const std::uint32_t place : places.subspan(1, places.size() - 2)) {
            kept_[chain.place(from + place)] = 1;
        }
    }

    /// Anew between two vertices that stayed, kAround segments before `middle` and behind it, but
    /// not further than `most` vertices.
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

    /// Of a loop that is one run. `places`: of what stayed, the first and the last being the start.
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

    /// Whether vertex `middle`, which is kept, and all others between are near to the segment.
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
    ScratchFile kept_file_;  ///< for each vertex of the chains whether it stays
    std::span<std::uint8_t> kept_;
    GrowingFile<Run> runs_;
    GrowingFile<std::uint64_t> long_chains_;  ///< of several runs
    tbb::enumerable_thread_specific<Worker> workers_;
};

}  // namespace

std::uint64_t simplify_lines_heap() {
    // Bits of FewestSegments; points, places, paths, and what waits to be written to files.
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
