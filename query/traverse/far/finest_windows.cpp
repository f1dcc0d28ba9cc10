#include "query/traverse/far/finest_windows.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "query/march/clip.h"
#include "query/traverse/bricks/facing_brick.h"
#include "query/traverse/far/brick_needs.h"
#include "query/traverse/far/from_last.h"

namespace isonest::detail {
namespace {

/// The bricks of level 0 in which some run may have some surface, the last in Morton order first.
class ReachedBricks {
  public:
    explicit ReachedBricks(Runs runs)
        : runs_(runs),
          query_(runs.front()->query),
          values_(runs.front()->layout().array(0, Field::values)),
          chunk_level_(chunk_level(runs.front()->layout())) {
        const Int3& grid = values_.grid;
        const auto size = static_cast<std::uint64_t>(std::max({grid.x, grid.y, grid.z}));
        left_.push_back({{0, 0, 0}, static_cast<std::int64_t>(std::bit_ceil(size))});
    }
    std::optional<Int3> next() {
        while (!left_.empty()) {
            const Part part = left_.back();
            left_.pop_back();
            if (!is_wanted(part)) {
                continue;
            }
            if (part.size == 1) {
                return part.first;
            }
            const std::int64_t half = part.size / 2;
            for (std::int64_t octant = 0; octant < 8; ++octant) {
                left_.push_back({part.first + kOctants.unlinear(octant) * half, half});
            }
        }
        return std::nullopt;
    }

  private:
    struct Part {
        Int3 first;
        std::int64_t size;  ///< in bricks
    };
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
    std::vector<Part> left_;
};

struct WindowBrick {
    Int3 brick;
    std::vector<bool> is_here;  ///< for each run: it has something here
};

/// In the order of work.
using Window = std::vector<WindowBrick>;

class FinestWindows {
  public:
    explicit FinestWindows(Runs runs) : runs_(runs), run_(*runs.front()), bricks_(runs) {}

    void traverse() {
        announce_rows();
        // While the first is worked on, the second waits for what its values name, the third for
        // those.
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

    /// Those of the bricks in the box, and of their neighbours: they say which bricks are reached.
    void announce_rows() {
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

    /// A new window, and what says whether it faces a viewer; without one, what the chunk table
    /// names.
    Window first_step() {
        const std::uint64_t most = run_.cache.budget() / kShare;
        const std::uint64_t most_heap = run_.query.waiting_lists / kShare;
        Window window;
        TraversalNeeds named;
        TraversalNeeds facing;
        while (window.empty() || (named.own.bytes() + facing.own.bytes() <= most &&
                                  named.own.heap() + facing.own.heap() <= most_heap)) {
            const auto brick = bricks_.next();
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
        announce(run_, run_.query.culling ? facing : named);
        return window;
    }

    /// With a viewer: what faces it stays, and is announced.
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
        announce(run_, named);
        return window;
    }

    /// What is known by the values alone.
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
        announce(run_, all);
    }

    void work_on(const Window& window) {
        from_last(window.size(), [&](std::size_t i) {
            run_.progress.check();
            // The first in the window is the one to go first.
            const WindowBrick& next = window[window.size() - 1 - i];
            for (std::size_t r = 0; r < runs_.size(); ++r) {
                if (next.is_here[r]) {
                    march_finest(*runs_[r], next.brick);
                }
            }
            leave_brick(run_, 0, next.brick);
        });
    }

    /// The chunks with values on both sides.
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
};

}  // namespace

void run_finest_windows(Runs runs, std::uint64_t progress_share) {
    FinestWindows(runs).traverse();
    runs.front()->progress.advance(progress_share);
}

}  // namespace isonest::detail
