#include "query/planar.h"

#include <algorithm>
#include <cmath>

#include "query/clip.h"
#include "query/node_sampler.h"

namespace isonest {
namespace {

/// Maubach's bisection in two dimensions. kind 0: half a square, its refinement edge v0 v2; kind 1:
/// a quarter of one, its refinement edge v0 v1.
struct Triangle {
    std::array<Int3, 3> v;
    std::array<double, 3> value;
    int kind = 0;
    int level = 0;  ///< the square's edge is 2^level
};

class PlanarTraversal {
  public:
    PlanarTraversal(ChunkCache& cache, const TraversalQuery& query, PlanarKind kind,
                    std::size_t part_vertices, const PartSink& sink, Progress& progress)
        : layout_(cache.source().layout()),
          query_(query),
          kind_(kind),
          part_vertices_(part_vertices),
          sink_(sink),
          progress_(progress),
          sampler_(cache),
          attributes_(query.attributes, cache, query.attribute_values),
          mesh_(&attributes_) {
        for (int axis = 0; axis < 3; ++axis) {
            if (layout_.lattice().nodes()[axis] > 1) {
                axes_.at(static_cast<std::size_t>(count_++)) = axis;
            }
        }
    }

    TraversalCounts run() {
        const int top = layout_.lattice().top();
        const std::int64_t edge = std::int64_t{1} << top;
        progress_.begin("extract", 2 * static_cast<std::uint64_t>(edge * edge), "");
        for (std::size_t order = 0; order < 2; ++order) {
            Triangle t;
            t.level = top;
            t.v[1][axes_.at(order)] = edge;
            t.v[2] = t.v[1];
            t.v[2][axes_.at(1 - order)] = edge;
            for (std::size_t i = 0; i < 3; ++i) {
                t.value[i] = sampler_.value(t.v[i], top);
            }
            visit(t);
        }
        flush();
        return counts_;
    }

  private:
    [[nodiscard]] static std::uint64_t doubled_area(const Triangle& t) {
        const auto square = std::uint64_t{1} << static_cast<unsigned>(2 * t.level);
        return t.kind == 0 ? square : square / 2;
    }
    [[nodiscard]] bool interesting(const Triangle& t, double beta) const {
        const auto [low, high] = std::minmax({t.value[0], t.value[1], t.value[2]});
        // Missing values never exclude anything: their beta is infinite.
        return kind_ == PlanarKind::graph ||
               (!(low - beta > query_.iso) && !(high + beta < query_.iso));
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
        const double scale = bound_scale(query_.bound, t.level - 1, layout_.header().spacing)[1];
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
    std::array<int, 2> axes_{};
    int count_ = 0;
    std::uint64_t parts_ = 0;
};

}  // namespace

TraversalCounts traverse_planar(ChunkCache& cache, const TraversalQuery& query, PlanarKind kind,
                                std::size_t part_vertices, const PartSink& sink,
                                Progress& progress) {
    return PlanarTraversal(cache, query, kind, part_vertices, sink, progress).run();
}

}  // namespace isonest
