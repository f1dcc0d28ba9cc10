#include "query/finite_elements/active_nodes.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>

#include "query/view/node_sampler.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kRowsPerTask = 64;

/// The refinement nodes of one slot: multiples of `scale` that are odd along `odd` and even along
/// the other axes.
struct SlotNodes {
    std::int64_t scale = 1;
    Int3 odd;    ///< 0 or 1 per axis
    Int3 count;  ///< in the volume, per axis

    SlotNodes(const Lattice& lattice, int level, int slot)
        : scale(std::int64_t{1} << (level - 1)), odd(slot_offset(slot)) {
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t last = lattice.nodes()[axis] - 1 - odd[axis] * scale;
            count[axis] = last < 0 ? 0 : last / (2 * scale) + 1;
        }
    }
    [[nodiscard]] Int3 node(const Int3& i) const { return (i * 2 + odd) * scale; }
};

/// The child nodes of a refinement node, some of them outside perhaps. Source: section 5.
class Children {
  public:
    Children(const Lattice& lattice, int level, const Int3& odd) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        std::array<int, 3> axes{};
        const auto size = static_cast<std::size_t>(lattice.dimension());
        for (std::size_t n = 0, axis = 0; axis < 3; ++axis) {
            if ((lattice.flat_axes() >> axis & 1U) == 0) {
                axes.at(n++) = static_cast<int>(axis);
            }
        }
        if (odd.x + odd.y + odd.z > 1) {
            for (std::size_t a = 0; a < size; ++a) {
                if (odd[axes.at(a)] != 0) {
                    for (const std::int64_t by : {-scale, scale}) {
                        offsets_.at(count_++)[axes.at(a)] = by;
                    }
                }
            }
        } else if (level > 1) {
            for (unsigned signs = 0; signs < 1U << size; ++signs) {
                for (std::size_t a = 0; a < size; ++a) {
                    offsets_.at(count_)[axes.at(a)] =
                        (signs >> a & 1U) != 0 ? scale / 2 : -scale / 2;
                }
                ++count_;
            }
        }
    }
    template <class F>
    [[nodiscard]] bool any_of(const F& f) const {
        return std::any_of(offsets_.begin(), offsets_.begin() + static_cast<std::ptrdiff_t>(count_),
                           f);
    }

  private:
    std::array<Int3, 8> offsets_{Int3{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0},
                                 {0, 0, 0},     {0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    std::size_t count_ = 0;
};

bool is_inside(const Int3& p, const Int3& nodes) {
    return min(p, Int3{0, 0, 0}) == Int3{0, 0, 0} && min(nodes - Int3{1, 1, 1}, p) == p;
}

/// wanted(p, level, local): `local` belongs to the thread.
template <class Local, class Wanted>
NodeSet find_active(const Lattice& lattice, const std::function<Local()>& make_local,
                    const Wanted& wanted, int threads, Progress& progress) {
    NodeSet set(lattice.nodes());
    const Int3 nodes = lattice.nodes();
    for (std::int64_t corner = 0; corner < 8; ++corner) {
        const Int3 p =
            Int3{corner & 1, corner >> 1 & 1, corner >> 2} * (std::int64_t{1} << lattice.top());
        if (is_inside(p, nodes)) {
            set.insert(p);
        }
    }
    // Edges first, then faces, then centres: a node after its children.
    std::array<int, kSlots> slots{0, 1, 3, 2, 4, 5, 6};
    progress.begin("grid", static_cast<std::uint64_t>(lattice.top()), "levels");
    Workers(threads).execute([&] {
        tbb::enumerable_thread_specific<Local> locals(make_local);
        for (int level = 1; level <= lattice.top(); ++level) {
            for (const int slot : slots) {
                if ((static_cast<unsigned>(slot + 1) & lattice.flat_axes()) != 0) {
                    continue;
                }
                const SlotNodes all(lattice, level, slot);
                const Children children(lattice, level, all.odd);
                tbb::parallel_for(
                    tbb::blocked_range<std::int64_t>(0, all.count.y * all.count.z, kRowsPerTask),
                    [&](const tbb::blocked_range<std::int64_t>& rows) {
                        progress.check();
                        Local& local = locals.local();
                        for (std::int64_t row = rows.begin(); row < rows.end(); ++row) {
                            for (std::int64_t i = 0; i < all.count.x; ++i) {
                                const Int3 p = all.node({i, row % all.count.y, row / all.count.y});
                                if (crosses_border(lattice, p, level) || wanted(p, level, local) ||
                                    children.any_of([&](const Int3& by) {
                                        return is_inside(p + by, nodes) && set.contains(p + by);
                                    })) {
                                    set.insert(p);
                                }
                            }
                        }
                    });
            }
            progress.advance(1);
        }
    });
    set.finish();
    return set;
}

struct NoLocal {};

}  // namespace

double hat_gradient(const Lattice& lattice, const Double3& spacing, int level, unsigned odd_axes) {
    const unsigned axes = 7U & ~lattice.flat_axes();
    const double half = std::ldexp(1.0, level - 1);
    // Squares of 1 / (half an edge), largest along the axes of a set.
    const auto largest = [&](unsigned set) {
        double most = 0;
        for (unsigned axis = 0; axis < 3; ++axis) {
            if ((set >> axis & 1U) != 0) {
                const double inverse = 1 / (half * spacing[axis]);
                most = std::max(most, inverse * inverse);
            }
        }
        return most;
    };
    // The hat falls to 0 along one axis from a centre of the element's own dimension, else along
    // two: one of the refinement edge's and one across it, or the edge's own and any other.
    if (odd_axes == axes) {
        return std::sqrt(largest(odd_axes));
    }
    return std::sqrt(largest(odd_axes) + largest(axes & ~odd_axes));
}

bool crosses_border(const Lattice& lattice, const Int3& p, int level) {
    const std::int64_t scale = std::int64_t{1} << (level - 1);
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t last = lattice.nodes()[axis] - 1;
        const bool odd = (p[axis] / scale & 1) != 0;
        if (last > 0 && p[axis] + scale > last && (odd || p[axis] < last)) {
            return true;
        }
    }
    return false;
}

NodeSet active_nodes(const Lattice& lattice,
                     const std::function<bool(const Int3& p, int level)>& wanted, int threads,
                     Progress& progress) {
    return find_active<NoLocal>(
        lattice, [] { return NoLocal{}; },
        [&](const Int3& p, int level, NoLocal&) { return wanted(p, level); }, threads, progress);
}

template <class Real>
NodeSet active_nodes(const Lattice& lattice, const Double3& spacing, std::span<const Real> values,
                     double threshold, int threads, Progress& progress) {
    const Int3 nodes = lattice.nodes();
    const Int3 last = nodes - Int3{1, 1, 1};
    std::vector<std::array<double, 8>> factors(static_cast<std::size_t>(lattice.top()) + 1);
    for (int level = 1; level <= lattice.top(); ++level) {
        for (unsigned odd = 1; odd < 8; ++odd) {
            factors[static_cast<std::size_t>(level)].at(odd) =
                (odd & lattice.flat_axes()) != 0 ? 0 : hat_gradient(lattice, spacing, level, odd);
        }
    }
    const auto wanted = [&](const Int3& p, int level, NoLocal&) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        Int3 end0 = p;
        Int3 end1 = p;
        unsigned odd = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t q = p[axis] / scale;
            if ((q & 1) != 0) {
                odd |= 1U << static_cast<unsigned>(axis);
                const std::int64_t by = (q & 2) != 0 ? -scale : scale;
                end0[axis] -= by;
                end1[axis] += by;
            }
        }
        const auto at = [&](const Int3& node) {
            return static_cast<double>(
                values[static_cast<std::size_t>(nodes.linear(min(node, last)))]);
        };
        const double offset = std::fabs(at(p) - 0.5 * (at(end0) + at(end1)));
        return offset * factors[static_cast<std::size_t>(level)][odd] >= threshold;
    };
    return find_active<NoLocal>(
        lattice, [] { return NoLocal{}; }, wanted, threads, progress);
}

template NodeSet active_nodes(const Lattice&, const Double3&, std::span<const float>, double, int,
                              Progress&);
template NodeSet active_nodes(const Lattice&, const Double3&, std::span<const double>, double, int,
                              Progress&);

NodeSet active_nodes(ChunkCache& cache, Field field, double threshold, int threads,
                     Progress& progress) {
    return find_active<NodeSampler>(
        cache.source().layout().lattice(), [&] { return NodeSampler(cache); },
        [&](const Int3& p, int, NodeSampler& sampler) {
            return sampler.indicator(p, field) >= threshold;
        },
        threads, progress);
}

}  // namespace isonest::detail
