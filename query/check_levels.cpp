#include "query/check_levels.h"

#include <fmt/format.h>

#include <cstring>

#include "query/brick_view.h"
#include "query/finest_indicators.h"
#include "store/gather.h"

namespace isonest {
namespace {

/// Codes near zero have fewer digits: the distance between two of them.
constexpr double kSmallestCode = decode_indicator(kCodeStep);
/// Numbers above it round up to infinity.
constexpr double kLargestCode = decode_indicator(IndicatorCode{kInfinityCode - kCodeStep});

class LevelChecks {
  public:
    LevelChecks(ChunkCache& cache, Findings& findings)
        : cache_(cache), layout_(cache.source().layout()), findings_(findings) {}

    /// Every node of a coarser level has the bits of the finer level's node.
    void injection(const ArrayInfo& array, const Int3& chunk) {
        if (array.level == 0) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const ArrayInfo& fine = layout_.array(array.level - 1, Field::values);
            const Int3 base = array.first_node(chunk);
            const Int3 n = min(array.chunk, array.nodes - base);
            Box<T> coarse(base, n);
            gather_values(cache_, array, coarse);
            Box<T> finer(base * 2, n * 2);
            gather_values(cache_, fine, finer);
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const Int3 p = base + n.unlinear(i);
                // Bit by bit: NaN is the same as itself.
                // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
                if (std::memcmp(&coarse.at(p), &finer.at(p * 2), sizeof(T)) != 0) {
                    findings_.add("injection", array, chunk, p * (std::int64_t{1} << array.level),
                                  "the value differs from the finer level's");
                }
            }
            findings_.count(n.product());
        });
    }

    /// Every refinement node is at least its children, in this chunk and across its borders: so the
    /// stop test of a node implies that of its parents, and leaves fit together.
    void saturation(const ArrayInfo& array, const Int3& chunk) {
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, array.nodes - base);
        const Int3 cells = layout_.lattice().cells_at(array.level);
        const auto exists = [&](const Int3& p) {
            return min(p, {0, 0, 0}) == Int3{0, 0, 0} && max(p, cells * 2) == cells * 2;
        };
        IndicatorView own(cache_, array, base);
        std::array<IndicatorView, 27> finer;
        const ArrayInfo* fine = nullptr;
        if (array.level > 1) {
            fine = &layout_.array(array.level - 1, array.field);
            for (std::size_t i = 0; i < 27; ++i) {
                const Int3 o =
                    (Int3{3, 3, 3}).unlinear(static_cast<std::int64_t>(i)) - Int3{1, 1, 1};
                finer[i] = IndicatorView(cache_, *fine, base * 2 + fine->first_node(o) * 2);
            }
        }
        std::int64_t compared = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 node = n.unlinear(i);
            for (int slot = 0; slot < array.components; ++slot) {
                const Int3 o = slot_offset(slot);
                const Int3 p = (base + node) * 2 + o;
                if (!exists(p)) {
                    continue;
                }
                const double value = own.at(node, slot);
                const auto against = [&](double child, const Int3& at, std::int64_t scale) {
                    ++compared;
                    if (!(value >= child)) {
                        findings_.add("saturation", array, chunk,
                                      p * (std::int64_t{1} << (array.level - 1)),
                                      fmt::format("{} is less than {} at its child {} {} {}", value,
                                                  child, at.x * scale, at.y * scale, at.z * scale));
                    }
                };
                const std::int64_t odd = o.x + o.y + o.z;
                if (odd >= 2) {
                    for (int axis = 0; axis < 3; ++axis) {
                        for (std::int64_t side = -1; side <= 1 && o[axis] != 0; side += 2) {
                            Int3 c = p;
                            c[axis] += side;
                            const Int3 q = c - base * 2;
                            against(own.at({q.x >> 1, q.y >> 1, q.z >> 1}, slot_of(q)), c,
                                    std::int64_t{1} << (array.level - 1));
                        }
                    }
                } else if (fine != nullptr) {
                    finer_centres(*fine, p, base, finer, against);
                }
            }
        }
        findings_.count(compared);
    }

  private:
    /// The centres of the up to eight cubes of level L-1 around the edge midpoint p.
    template <class F>
    void finer_centres(const ArrayInfo& fine, const Int3& p, const Int3& base,
                       std::array<IndicatorView, 27>& finer, F&& against) {
        const Int3 cells = layout_.lattice().elements_at(fine.level);
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 cube = p - Int3{i & 1, (i >> 1) & 1, i >> 2};
            // Along a flat axis p is 0, and so is the square.
            if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} ||
                max(cube + Int3{1, 1, 1}, cells) != cells) {
                continue;
            }
            // Cubes 2 base - 1 to 2 (base + chunk): in one of the blocks of chunks around.
            const Int3 local = cube - base * 2;
            Int3 block;
            Int3 rest;
            for (int axis = 0; axis < 3; ++axis) {
                const std::int64_t size = 2 * fine.chunk[axis];
                block[axis] = local[axis] < 0 ? 0 : local[axis] < size ? 1 : 2;
                rest[axis] = local[axis] - (block[axis] - 1) * size;
            }
            const int centre = layout_.lattice().centre_slot();
            against(finer[static_cast<std::size_t>((Int3{3, 3, 3}).linear(block))].at(rest, centre),
                    cube * 2 + slot_offset(centre), std::int64_t{1} << (fine.level - 1));
        }
    }

  public:
    /// Level 1: the stored centre of each cube against the indicators of its 19 nodes, which follow
    /// from the values: never below, and at most the codes' rounding above.
    void finest_bounds(const ArrayInfo& array, const Int3& chunk) {
        const Int3 base = array.first_node(chunk);
        const Int3 n = min(array.chunk, layout_.lattice().elements_at(1) - base);
        if (min(n, {1, 1, 1}) != Int3{1, 1, 1}) {
            return;
        }
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            Box<T> values(base * 2, n * 2 + Int3{1, 1, 1});
            gather_values(cache_, layout_.array(0, Field::values), values);
            IndicatorView own(cache_, array, base);
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const Int3 cube = base + n.unlinear(i);
                const double stored = own.at(cube - base, array.first_slot);
                const double computed =
                    finest_indicator(cube_values(values, cube), position_of_slot(array.first_slot),
                                     saturation_of(array.field) == Saturation::plus);
                const bool tight = stored <= computed * (1 + kCodeExcess) + kSmallestCode ||
                                   computed > kLargestCode;
                if (!(stored >= computed) || !tight) {
                    findings_.add(
                        "indicator", array, chunk, cube * 2 + slot_offset(array.first_slot),
                        fmt::format("{} is stored, {} follows from the values", stored, computed));
                }
            }
            findings_.count(n.product());
        });
    }

  private:
    ChunkCache& cache_;
    const StoreLayout& layout_;
    Findings& findings_;
};

}  // namespace

void check_levels(ChunkCache& cache, Findings& findings, const ArrayInfo& array,
                  const Int3& chunk) {
    LevelChecks checks(cache, findings);
    if (array.field == Field::values) {
        checks.injection(array, chunk);
    } else if (array.level == 1 && centre_suffices_at_level_1(array.field)) {
        checks.finest_bounds(array, chunk);
    } else {
        checks.saturation(array, chunk);
    }
}

}  // namespace isonest
