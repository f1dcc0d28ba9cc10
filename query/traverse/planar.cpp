#include "query/traverse/planar.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/march/clip.h"
#include "query/traverse/interest.h"
#include "query/view/node_sampler.h"

namespace isonest::detail {
namespace {

/// Maubach's bisection in two dimensions. kind 0: half a square, its refinement edge v0 v2; kind 1:
/// a quarter of one, its refinement edge v0 v1.
struct Triangle {
    std::array<Int3, 3> v;
    std::array<double, 3> value;
    int kind = 0;
    int level = 0;  ///< the square's edge is 2^level
};

/// Most by which the heights scale * value are rounded as float32; where the box cuts, of what lies
/// between them as well.
double height_rounding(const std::array<double, 3>& values, double scale, bool cut) {
    double most = 0;
    for (const double value : values) {
        const double height = scale * value;
        const auto stored = static_cast<float>(height);
        most = std::max(most, std::fabs(static_cast<double>(stored) - height) +
                                  std::fabs(std::fma(scale, value, -height)));
        if (cut) {
            const float size = std::fabs(stored);
            const float next = std::nextafter(size, std::numeric_limits<float>::infinity());
            most = std::max(most, static_cast<double>(next) - static_cast<double>(size));
        }
    }
    return most;
}

/// What the threads share.
struct PlanarWork {
    ChunkCache& cache;
    const TraversalQuery& query;
    PlanarKind kind;
    std::size_t part_vertices;
    const PartSink& sink;
    Progress& progress;
};

/// Visits one subtree at a time. One per thread.
class PlanarTraversal {
  public:
    explicit PlanarTraversal(const PlanarWork& work)
        : layout_(work.cache.source().layout()),
          query_(work.query),
          kind_(work.kind),
          part_vertices_(work.part_vertices),
          sink_(work.sink),
          progress_(work.progress),
          sampler_(work.cache),
          attributes_(query_.attributes, work.cache, query_.attribute_values),
          mesh_(&attributes_) {}
    PlanarTraversal(const PlanarTraversal&) = delete;
    PlanarTraversal& operator=(const PlanarTraversal&) = delete;

    /// The two halves of the coarsest square, down to triangles of `level`, which are left for
    /// others: those are returned.
    std::vector<Triangle> top(int level) {
        std::array<int, 2> axes{};
        int count = 0;
        for (int axis = 0; axis < 3; ++axis) {
            if (layout_.lattice().nodes()[axis] > 1) {
                axes.at(static_cast<std::size_t>(count++)) = axis;
            }
        }
        std::vector<Triangle> left;
        left_ = &left;
        left_level_ = level;
        const int top = layout_.lattice().top();
        const std::int64_t edge = std::int64_t{1} << top;
        for (std::size_t order = 0; order < 2; ++order) {
            Triangle t;
            t.level = top;
            t.v[1][axes.at(order)] = edge;
            t.v[2] = t.v[1];
            t.v[2][axes.at(1 - order)] = edge;
            for (std::size_t i = 0; i < 3; ++i) {
                t.value[i] = sampler_.value(t.v[i], top);
            }
            visit(t);
        }
        flush();
        left_ = nullptr;
        return left;
    }
    /// The subtree of `t`; its parts' numbers begin with `number`.
    void subtree(const Triangle& t, std::uint64_t number) {
        constexpr unsigned kPartBits = 40;
        parts_ = number << kPartBits;
        visit(t);
        flush();
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.value_rounding = std::max(counts.value_rounding, attributes_.value_rounding());
        return counts;
    }

  private:
    [[nodiscard]] static std::uint64_t doubled_area(const Triangle& t) {
        const auto square = std::uint64_t{1} << static_cast<unsigned>(2 * t.level);
        return t.kind == 0 ? square : square / 2;
    }
    [[nodiscard]] bool interesting(const Triangle& t, double beta) const {
        const auto [low, high] = std::minmax({t.value[0], t.value[1], t.value[2]});
        return kind_ == PlanarKind::graph || may_reach(low, high, beta, query_.iso);
    }
    [[nodiscard]] Overlap overlap(const Triangle& t) const {
        Int3 low = t.v[0];
        Int3 high = t.v[0];
        for (const Int3& v : t.v) {
            low = min(low, v);
            high = max(high, v);
        }
        return overlap_of(query_.box, low, high);
    }

    void visit(const Triangle& t) {
        if (left_ != nullptr && t.kind == 0 && t.level == left_level_) {
            left_->push_back(t);
            return;
        }
        const Overlap where = overlap(t);
        if (where == Overlap::outside) {
            return done(t);
        }
        ++counts_.visited;
        if (t.level == 0) {
            if (interesting(t, 0)) {
                march(t, 0, where);
            }
            return done(t);
        }
        const std::size_t end = t.kind == 0 ? 2 : 1;
        const Int3 sum = t.v[0] + t.v[end];
        const Int3 x{sum.x / 2, sum.y / 2, sum.z / 2};
        const double scale = bound_scale(query_.bound, t.level, layout_.header().spacing);
        const double bound = kind_ == PlanarKind::graph ? 0 : sampler_.indicator(x, query_.bound);
        if (!interesting(t, bound * scale)) {
            return done(t);
        }
        if (!query_.tolerance.is_zero()) {
            const double eta = query_.stop == query_.bound && kind_ == PlanarKind::isolines
                                   ? bound
                                   : sampler_.indicator(x, query_.stop);
            if (query_.tolerance.stops(eta, x * 2, std::int64_t{1} << t.level)) {
                march(t, eta, where);
                return done(t);
            }
        }
        const double value = sampler_.value(x, t.level - 1);
        for (std::size_t child = 0; child < 2; ++child) {
            Triangle c = t;
            c.kind = 1 - t.kind;
            c.level = t.level - t.kind;
            if (child == 1) {
                for (std::size_t i = 0; i < end; ++i) {
                    c.v[i] = t.v[i + 1];
                    c.value[i] = t.value[i + 1];
                }
            }
            c.v[end] = x;
            c.value[end] = value;
            visit(c);
        }
    }

    void done(const Triangle& t) { progress_.advance(doubled_area(t)); }

    void march(const Triangle& t, double eta, Overlap where) {
        if (!std::isfinite(t.value[0] + t.value[1] + t.value[2])) {
            return;
        }
        ++counts_.leaves;
        counts_.error_bound = std::max(counts_.error_bound, eta);
        const bool cut = where == Overlap::crossing;
        std::array<Corner, 3> corners;
        for (std::size_t i = 0; i < 3; ++i) {
            corners[i] = {t.v[i], t.value[i]};
        }
        if (kind_ == PlanarKind::isolines) {
            mesh_.march_line(corners, query_.iso, cut);
        } else {
            mesh_.add_graph(corners, cut);
            counts_.height_rounding =
                std::max(counts_.height_rounding,
                         height_rounding(t.value, *query_.attributes.graph_scale, cut));
        }
        if (mesh_.size() >= part_vertices_) {
            flush();
        }
    }

    void flush() {
        progress_.check();
        if (!mesh_.empty()) {
            sink_(parts_++, mesh_.finish(query_.box));
        }
    }

    const StoreLayout& layout_;
    const TraversalQuery& query_;
    PlanarKind kind_;
    std::size_t part_vertices_;
    const PartSink& sink_;
    Progress& progress_;
    NodeSampler sampler_;
    AttributeSampler attributes_;
    LocalMesh mesh_;
    TraversalCounts counts_;
    std::uint64_t parts_ = 0;
    std::vector<Triangle>* left_ = nullptr;  ///< where triangles of left_level_ go
    int left_level_ = 0;
};

/// Levels below the coarsest at which the subtrees begin that are the threads' work: at most 2 *
/// 4^5 of them.
constexpr int kTopLevels = 5;

}  // namespace

TraversalCounts traverse_planar(ChunkCache& cache, const TraversalQuery& query, PlanarKind kind,
                                std::size_t part_vertices, const PartSink& sink,
                                Progress& progress) {
    const PlanarWork work{cache, query, kind, part_vertices, sink, progress};
    const int top = cache.source().layout().lattice().top();
    const std::uint64_t edge = std::uint64_t{1} << static_cast<unsigned>(top);
    progress.begin("extract", 2 * edge * edge, "");
    tbb::enumerable_thread_specific<PlanarTraversal> traversals(
        [&] { return PlanarTraversal(work); });
    const std::vector<Triangle> left = traversals.local().top(std::max(top - kTopLevels, 0));
    tbb::parallel_for(std::size_t{0}, left.size(),
                      [&](std::size_t i) { traversals.local().subtree(left[i], i + 1); });
    TraversalCounts counts;
    for (const PlanarTraversal& t : traversals) {
        counts.add(t.counts());
    }
    return counts;
}

}  // namespace isonest::detail
