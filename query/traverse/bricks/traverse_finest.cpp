#include "query/traverse/bricks/traverse_finest.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>

#include "query/march/clip.h"
#include "query/traverse/bricks/finest_brick.h"
#include "query/traverse/remote/brick_needs.h"

namespace isonest::detail {
namespace {

/// Whether the chunk table allows surface in the brick.
bool is_reached(const TraversalRun& run, const Int3& brick) {
    return may_hold_surface(run.cache.source(), brick, run.query.iso, run.query.box);
}

/// Whether a part of a brick may face the query's viewer, if there is one; counts the tests.
bool is_seen(TraversalRun& run, const Int3& brick) {
    const TraversalQuery& query = run.query;
    TraversalCounts& counts = run.counts.local();
    const std::uint64_t visited = counts.visited;
    const bool is_seen = !query.culling || may_face_viewer(run, brick);
    if (!query.share.owns(chunk_level(run.layout()), brick)) {
        counts.visited = visited;
    }
    return is_seen;
}

void march_reached(TraversalRun& run, const Int3& brick) {
    const TraversalQuery& query = run.query;
    if (const auto cubes = surface_cubes(run.cache, brick, query.iso, query.box)) {
        run.counts.local().bricks += query.share.owns(chunk_level(run.layout()), brick) ? 1 : 0;
        march_finest_brick(run, brick, *cubes);
    }
}

/// The bricks of level 0 in which some run may have surface, as an octree.
class ReachedBricks {
  public:
    /// A cube of `size`^3 bricks.
    struct Part {
        Int3 first;
        std::int64_t size;
    };

    explicit ReachedBricks(Runs runs)
        : runs_(runs),
          query_(runs.front()->query),
          values_(runs.front()->layout().array(0, Field::values)),
          chunk_level_(chunk_level(runs.front()->layout())) {}

    /// The whole octree, or nothing if it is not needed.
    [[nodiscard]] std::vector<Part> root() const {
        const Int3& grid = values_.grid;
        const auto size = static_cast<std::uint64_t>(std::max({grid.x, grid.y, grid.z}));
        const Part all{{0, 0, 0}, static_cast<std::int64_t>(std::bit_ceil(size))};
        return is_wanted(all) ? std::vector<Part>{all} : std::vector<Part>{};
    }
    /// The eighths of a part that are needed, in Morton order.
    [[nodiscard]] std::vector<Part> eighths(const Part& part) const {
        std::vector<Part> wanted;
        const std::int64_t half = part.size / 2;
        for (std::int64_t octant = 0; octant < 8; ++octant) {
            const Part eighth{part.first + kOctants.unlinear(octant) * half, half};
            if (is_wanted(eighth)) {
                wanted.push_back(eighth);
            }
        }
        return wanted;
    }

  private:
    [[nodiscard]] bool is_wanted(const Part& part) const {
        const std::int64_t chunk = std::int64_t{1} << chunk_level_;
        const int level = chunk_level_ + std::countr_zero(static_cast<std::uint64_t>(part.size));
        const Int3 low = part.first * chunk;
        const Int3 at{part.first.x / part.size, part.first.y / part.size, part.first.z / part.size};
        return values_.has_chunk(part.first) && query_.share.meets(level, at) &&
               overlap_of(query_.box, low, low + Int3{chunk, chunk, chunk} * part.size) !=
                   Overlap::outside &&
               (part.size > 1 || std::any_of(runs_.begin(), runs_.end(), [&](const auto& run) {
                    return is_reached(*run, part.first);
                }));
    }

    Runs runs_;
    const TraversalQuery& query_;
    const ArrayInfo& values_;
    int chunk_level_;
};

/// Depth first, for a local store.
class FinestDepthFirst {
  public:
    explicit FinestDepthFirst(Runs runs) : runs_(runs), run_(*runs.front()), bricks_(runs) {}

    void traverse(std::uint64_t progress_share) { visit_all(bricks_.root(), progress_share); }

  private:
    using Part = ReachedBricks::Part;

    void visit_all(std::vector<Part> parts, std::uint64_t progress_share) {
        visit_parts(run_.progress, std::move(parts), progress_share,
                    [this](const Part& part, std::uint64_t share) { visit(part, share); });
    }
    void visit(const Part& part, std::uint64_t progress_share) {
        run_.progress.check();
        if (part.size == 1) {
            for (const auto& run : runs_) {
                if ((runs_.size() == 1 || is_reached(*run, part.first)) &&
                    is_seen(*run, part.first)) {
                    march_reached(*run, part.first);
                }
            }
            run_.leave(0, part.first);
            run_.progress.advance(progress_share);
            return;
        }
        std::vector<Part> eighths = bricks_.eighths(part);
        if (part.size == 2 && !run_.query.culling) {
            for (const Part& eighth : eighths) {
                run_.cache.source().prefetch(run_.layout().array(0, Field::values), eighth.first);
            }
        }
        visit_all(std::move(eighths), progress_share);
    }

    Runs runs_;
    TraversalRun& run_;
    ReachedBricks bricks_;
};

struct WindowBrick {
    Int3 brick;
    std::vector<bool> is_here;  ///< for each run: whether it has surface here
};

/// In the order of processing.
using Window = std::vector<WindowBrick>;

/// In windows, for a remote store: each is prefetched while the previous one is processed. Bricks
/// are processed in reverse Morton order. The needs of a brick are found in up to three steps, each
/// for a whole window: with a viewer, the cubes of level 3 decide whether some of it faces the
/// viewer; the chunk table gives the chunks with values on both sides of the isovalue; their values
/// give the other chunks that the surface reaches. A window's chunks use an eighth of the cache,
/// decoded, and three windows are in progress; a window has at least one brick.
class FinestWindows {
  public:
    explicit FinestWindows(Runs runs) : runs_(runs), run_(*runs.front()), bricks_(runs) {}

    void traverse() {
        prefetch_rows();
        left_ = bricks_.root();
        // While the first window is processed, the second waits for what its values require, and
        // the third for its values.
        Window first;
        Window second = second_step(first_step());
        while (!first.empty() || !second.empty()) {
            Window third = second_step(first_step());
            third_step(second);
            work_on(first);
            first = std::move(second);
            second = std::move(third);
        }
    }

  private:
    static constexpr std::uint64_t kShare = 8;  ///< of the cache, for a window: 1 / 8

    /// Prefetches table rows of the bricks in the box, and of their neighbours: they decide which
    /// bricks are reached.
    void prefetch_rows() {
        const ArrayInfo& values = run_.layout().array(0, Field::values);
        const auto chunk = static_cast<double>(run_.layout().header().chunk);
        const ClipBox& box = run_.query.box;
        Int3 begin;
        Int3 end;
        for (int axis = 0; axis < 3; ++axis) {
            const auto most = static_cast<double>(values.grid[axis]);
            const double low = std::clamp(std::floor(box.lo[axis] / chunk) - 1, 0.0, most);
            const double high = std::clamp(std::floor(box.hi[axis] / chunk) + 2, 0.0, most);
            begin[axis] = static_cast<std::int64_t>(low);
            end[axis] = static_cast<std::int64_t>(high);
        }
        run_.cache.source().prefetch_rows(values, begin, end);
    }

    std::optional<Int3> next_brick() {
        while (!left_.empty()) {
            const ReachedBricks::Part part = left_.back();
            left_.pop_back();
            if (part.size == 1) {
                return part.first;
            }
            const std::vector<ReachedBricks::Part> eighths = bricks_.eighths(part);
            left_.insert(left_.end(), eighths.begin(), eighths.end());
        }
        return std::nullopt;
    }

    /// Creates a window and prefetches the data that decides whether it faces the viewer; without a
    /// viewer, the chunks given by the chunk table.
    Window first_step() {
        const std::uint64_t most = run_.cache.budget() / kShare;
        const std::uint64_t max_heap = run_.query.waiting_lists / kShare;
        Window window;
        TraversalNeeds named;
        TraversalNeeds facing;
        while (window.empty() || (named.own.bytes() + facing.own.bytes() <= most &&
                                  named.own.heap() + facing.own.heap() <= max_heap)) {
            const auto brick = next_brick();
            if (!brick) {
                break;
            }
            WindowBrick next{*brick, {}};
            for (const auto& run : runs_) {
                next.is_here.push_back(runs_.size() == 1 || is_reached(*run, *brick));
            }
            add_named(next, named);
            if (run_.query.culling) {
                add_facing_needs(run_, *brick, facing.own);
            }
            window.push_back(std::move(next));
        }
        prefetch(run_, run_.query.culling ? facing : named);
        return window;
    }

    /// With a viewer: keeps what faces it, and prefetches that.
    Window second_step(Window window) {
        if (!run_.query.culling) {
            return window;
        }
        from_last(window.size(), [&](std::size_t i) {
            for (std::size_t r = 0; r < runs_.size(); ++r) {
                window[i].is_here[r] = window[i].is_here[r] && is_seen(*runs_[r], window[i].brick);
            }
        });
        TraversalNeeds named;
        for (const WindowBrick& brick : window) {
            add_named(brick, named);
        }
        prefetch(run_, named);
        return window;
    }

    /// Prefetches what is known only from the values.
    void third_step(const Window& window) {
        std::vector<TraversalNeeds> needs(window.size());
        from_last(window.size(), [&](std::size_t i) {
            run_.progress.check();
            for (std::size_t r = 0; r < runs_.size(); ++r) {
                if (!window[i].is_here[r]) {
                    continue;
                }
                const TraversalQuery& query = runs_[r]->query;
                const auto cubes = surface_cubes(run_.cache, window[i].brick, query.iso, query.box);
                if (cubes != nullptr) {
                    add_finest_needs(run_, window[i].brick, *cubes, needs[i]);
                }
            }
        });
        TraversalNeeds all;
        for (const TraversalNeeds& of_brick : needs) {
            all.add(of_brick);
        }
        prefetch(run_, all);
    }

    void work_on(const Window& window) {
        from_last(window.size(), [&](std::size_t i) {
            run_.progress.check();
            // The first brick in the window is processed first.
            const WindowBrick& next = window[window.size() - 1 - i];
            for (std::size_t r = 0; r < runs_.size(); ++r) {
                if (next.is_here[r]) {
                    march_reached(*runs_[r], next.brick);
                }
            }
            run_.leave(0, next.brick);
        });
    }

    /// Adds the chunks with values on both sides.
    void add_named(const WindowBrick& brick, TraversalNeeds& needs) const {
        for (std::size_t r = 0; r < runs_.size(); ++r) {
            if (brick.is_here[r]) {
                add_chunks_on_both_sides(run_.cache.source(), brick.brick, runs_[r]->query.iso,
                                         run_.query.box, needs.own);
            }
        }
    }

    Runs runs_;
    TraversalRun& run_;
    ReachedBricks bricks_;
    std::vector<ReachedBricks::Part> left_;
};

}  // namespace

void traverse_finest(Runs runs, std::uint64_t progress_share) {
    if (runs.front()->cache.source().is_remote()) {
        FinestWindows(runs).traverse();
        runs.front()->progress.advance(progress_share);
    } else {
        FinestDepthFirst(runs).traverse(progress_share);
    }
}

TraversalCounts traverse_finest_layer(TraversalRun& run, std::int64_t layer) {
    const ArrayInfo& values = run.layout().array(0, Field::values);
    tbb::parallel_for(std::int64_t{0}, values.grid.x * values.grid.y, [&](std::int64_t i) {
        run.progress.check();
        const Int3 brick{i % values.grid.x, i / values.grid.x, layer};
        const Int3 low = values.first_node(brick);
        if (overlap_of(run.query.box, low, low + values.chunk) != Overlap::outside &&
            is_reached(run, brick)) {
            march_reached(run, brick);
        }
    });
    return run.total();
}

}  // namespace isonest::detail
