#include "query/finite_elements/active_nodes.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "query/values/node_sampler.h"
#include "store/base/workers.h"
#include "store/lattice/children.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kRowsPerTask = 64;

/// The children of the nodes of a slot, as offsets; some may be outside.
class Children {
  public:
    Children(const Lattice& lattice, const SlotRows& rows) {
        const unsigned odd = static_cast<unsigned>(rows.odd.x + 2 * rows.odd.y + 4 * rows.odd.z);
        const std::int64_t step = child_scale(odd, rows.scale);
        for (const Int3& offset : child_offsets(odd, lattice.flat_axes())) {
            offsets_.at(count_) = offset * step;
            count_ += step > 0 ? 1 : 0;
        }
    }
    [[nodiscard]] std::span<const Int3> offsets() const { return {offsets_.data(), count_}; }

  private:
    std::array<Int3, 8> offsets_{};
    std::size_t count_ = 0;
};

/// Sets bit x of `to` if bit x + by of `from` is set; both have the same length.
void or_shifted(std::span<std::uint64_t> to, std::span<const std::uint64_t> from, std::int64_t by) {
    const auto size = static_cast<std::int64_t>(to.size());
    const std::int64_t words = by >= 0 ? by / 64 : -((-by + 63) / 64);
    const auto bits = static_cast<unsigned>(by - 64 * words);
    for (std::int64_t w = 0; w < size; ++w) {
        const auto at = [&](std::int64_t i) {
            return i >= 0 && i < size ? from[static_cast<std::size_t>(i)] : 0;
        };
        to[static_cast<std::size_t>(w)] |=
            at(w + words) >> bits | (bits == 0 ? 0 : at(w + words + 1) << (64 - bits));
    }
}

/// A thread's buffer for one row.
struct RowBits {
    std::vector<std::uint64_t> slot;  ///< the nodes of a slot
    std::vector<std::uint64_t> refined;

    explicit RowBits(std::size_t words) : slot(words), refined(words) {}
    [[nodiscard]] bool all_refined() const {
        for (std::size_t w = 0; w < slot.size(); ++w) {
            if ((slot[w] & ~refined[w]) != 0) {
                return false;
            }
        }
        return true;
    }
};

void set_bit(std::span<std::uint64_t> words, std::int64_t x, bool value) {
    words[static_cast<std::size_t>(x / 64)] |= (value ? std::uint64_t{1} : 0)
                                               << static_cast<unsigned>(x % 64);
}

/// Whether the elements that may be refined at a node of this coordinate extend beyond the volume
/// along the axis, without being entirely outside.
bool crosses_border(std::int64_t p, std::int64_t last, std::int64_t scale, bool is_odd) {
    return last > 0 && p + scale > last && (is_odd || p < last);
}

/// wanted(rows, row, level, bits, local) sets the bits of the wanted nodes of a row; it may skip
/// those already set. `local` belongs to the thread.
template <class Local, class Wanted>
NodeSet find_active(const Lattice& lattice, const std::function<Local()>& make_local,
                    const Wanted& wanted, int threads, Progress& progress) {
    NodeSet set(lattice.nodes());
    const Int3 nodes = lattice.nodes();
    const Int3 last = nodes - Int3{1, 1, 1};
    for (std::int64_t corner = 0; corner < 8; ++corner) {
        const Int3 p =
            Int3{corner & 1, corner >> 1 & 1, corner >> 2} * (std::int64_t{1} << lattice.top());
        if (min(last, p) == p) {
            set.insert(p);
        }
    }
    const auto refine_row = [&](const SlotRows& rows, const Children& children, std::int64_t row,
                                int level, RowBits& bits, Local& local) {
        const Int3 first = rows.first_of(row);
        const auto crosses = [&](int axis, std::int64_t p) {
            return crosses_border(p, last[axis], rows.scale, rows.odd[axis] != 0);
        };
        if (crosses(1, first.y) || crosses(2, first.z)) {
            bits.refined = bits.slot;
        } else {
            std::fill(bits.refined.begin(), bits.refined.end(), 0);
            for (const Int3& by : children.offsets()) {
                const std::int64_t y = first.y + by.y;
                const std::int64_t z = first.z + by.z;
                if (y >= 0 && y <= last.y && z >= 0 && z <= last.z) {
                    or_shifted(bits.refined, std::as_const(set).row_words(y, z), by.x);
                }
            }
            for (std::int64_t i = rows.count.x; i-- > 0;) {
                const std::int64_t x = first.x + 2 * i * rows.scale;
                if (!crosses(0, x)) {
                    break;
                }
                set_bit(bits.refined, x, true);
            }
            if (!bits.all_refined()) {
                wanted(rows, row, level, std::span<std::uint64_t>(bits.refined), local);
            }
        }
        const std::span<std::uint64_t> words = set.row_words(first.y, first.z);
        for (std::size_t w = 0; w < words.size(); ++w) {
            words[w] |= bits.refined[w] & bits.slot[w];
        }
    };
    // Edges first, then faces, then centres: each node after its children.
    std::array<int, kSlots> slots{0, 1, 3, 2, 4, 5, 6};
    progress.begin("grid", static_cast<std::uint64_t>(lattice.top()), "levels");
    Workers(threads).execute([&] {
        tbb::enumerable_thread_specific<Local> locals(make_local);
        const std::size_t words = set.row_words(0, 0).size();
        for (int level = 1; level <= lattice.top(); ++level) {
            for (const int slot : slots) {
                if ((static_cast<unsigned>(slot + 1) & lattice.flat_axes()) != 0) {
                    continue;
                }
                const SlotRows rows(lattice, level, slot);
                const Children children(lattice, rows);
                RowBits empty(words);
                for (std::int64_t i = 0; i < rows.count.x; ++i) {
                    set_bit(empty.slot, (2 * i + rows.odd.x) * rows.scale, true);
                }
                tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, rows.rows(), kRowsPerTask),
                                  [&](const tbb::blocked_range<std::int64_t>& r) {
                                      progress.check();
                                      RowBits bits = empty;
                                      for (std::int64_t row = r.begin(); row < r.end(); ++row) {
                                          refine_row(rows, children, row, level, bits,
                                                     locals.local());
                                      }
                                  });
            }
            progress.advance(1);
        }
    });
    set.finish();
    return set;
}

/// The same, node by node: wanted(p, level, local).
template <class Local, class Wanted>
NodeSet find_active_by_node(const Lattice& lattice, const std::function<Local()>& make_local,
                            const Wanted& wanted, int threads, Progress& progress) {
    return find_active<Local>(
        lattice, make_local,
        [&](const SlotRows& rows, std::int64_t row, int level, std::span<std::uint64_t> bits,
            Local& local) {
            for (std::int64_t i = 0; i < rows.count.x; ++i) {
                const Int3 p = rows.node(i, row);
                const std::uint64_t word = bits[static_cast<std::size_t>(p.x / 64)];
                if ((word >> static_cast<unsigned>(p.x % 64) & 1U) == 0) {
                    set_bit(bits, p.x, wanted(p, level, local));
                }
            }
        },
        threads, progress);
}

struct NoLocal {};

}  // namespace

double hat_gradient(const Lattice& lattice, const Double3& spacing, int level, unsigned odd_axes) {
    const unsigned axes = 7U & ~lattice.flat_axes();
    const double half = std::ldexp(1.0, level - 1);
    // Squares of 1 / (half an edge); the maximum over the axes of a set.
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
    // At a centre of the element's own dimension the hat falls to 0 along one axis, otherwise along
    // two: one axis of the refinement edge and one across it, or the edge's own axis and any other.
    if (odd_axes == axes) {
        return std::sqrt(largest(odd_axes));
    }
    return std::sqrt(largest(odd_axes) + largest(axes & ~odd_axes));
}

NodeSet active_nodes(const Lattice& lattice,
                     const std::function<bool(const Int3& p, int level)>& wanted, int threads,
                     Progress& progress) {
    return find_active_by_node<NoLocal>(
        lattice, [] { return NoLocal{}; },
        [&](const Int3& p, int level, NoLocal&) { return wanted(p, level); }, threads, progress);
}

template <class Real>
NodeSet active_nodes(const Lattice& lattice, const Double3& spacing, std::span<const Real> values,
                     double threshold, int threads, Progress& progress) {
    const Int3 nodes = lattice.nodes();
    std::vector<std::array<double, 8>> factors(static_cast<std::size_t>(lattice.top()) + 1);
    for (int level = 1; level <= lattice.top(); ++level) {
        for (unsigned odd = 1; odd < 8; ++odd) {
            factors[static_cast<std::size_t>(level)].at(odd) =
                (odd & lattice.flat_axes()) != 0 ? 0 : hat_gradient(lattice, spacing, level, odd);
        }
    }
    const auto wanted = [&](const SlotRows& rows, std::int64_t row, int level,
                            std::span<std::uint64_t> bits, NoLocal&) {
        const Int3 first = rows.first_of(row);
        const Int3 half = rows.half_edge(0, first);
        const auto odd = static_cast<std::size_t>(rows.odd.x + 2 * rows.odd.y + 4 * rows.odd.z);
        const double factor = factors[static_cast<std::size_t>(level)].at(odd);
        const auto from = [&](std::int64_t y, std::int64_t z) {
            return values.data() + nodes.linear({0, y, z});
        };
        const Real* const middle = from(first.y, first.z);
        const Real* const end0 = from(first.y - half.y, first.z - half.z);
        const Real* const end1 = from(first.y + half.y, first.z + half.z);
        for (std::int64_t i = 0, x = first.x; i < rows.count.x; ++i, x += 2 * rows.scale) {
            const std::int64_t by = i % 2 != 0 ? -half.x : half.x;
            // If an end would be outside, the element crosses the border: its bit is set.
            if (x + rows.odd.x * rows.scale < nodes.x) {
                const double ends =
                    static_cast<double>(end0[x - by]) + static_cast<double>(end1[x + by]);
                const double offset = std::fabs(static_cast<double>(middle[x]) - 0.5 * ends);
                set_bit(bits, x, offset * factor >= threshold);
            }
        }
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
    return find_active_by_node<NodeSampler>(
        cache.source().layout().lattice(), [&] { return NodeSampler(cache); },
        [&](const Int3& p, int, NodeSampler& sampler) {
            return sampler.indicator(p, field) >= threshold;
        },
        threads, progress);
}

}  // namespace isonest::detail
