// One block's part of z = A w: its nodes are gathered, its leaves visited, the sums scattered.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "query/finite_elements/block_elements.h"

namespace isonest::detail {

template <ElementWork Work, bool Coefficient, class Real, int D>
class BlockProduct {
  public:
    /// What all blocks of a product have in common.
    struct Common {
        const NodeSet* nodes = nullptr;
        std::span<const Real> value;
        std::span<const Real> stopping;
        std::span<Real> sum;
        TermsTable<Real, D> terms{};
        std::int64_t cells = 1;  ///< of a block, along an axis
        int level = 0;           ///< of a block
        unsigned flat = 0;
        std::vector<std::array<int, static_cast<std::size_t>(D)>> walks;
    };

    explicit BlockProduct(const Common& common) : common_(common), block_(common.flat) {}

    /// `elements`: bits of the walks that are this block's.
    void operator()(const Int3& corner, std::uint32_t elements) {
        gather(corner);
        if constexpr (D == 3) {
            finest();
        }
        if (D < 3 || (!block_.is_full && common_.level > 0)) {
            visit(corner, elements);
        }
        scatter();
    }

  private:
    static constexpr bool kHasValue =
        Work == ElementWork::stiffness || Work == ElementWork::consistent_mass;

    /// Calls f(first, p, count) for each row along x: its place in the arrays, its first node.
    template <class F>
    void for_rows(const F& f) {
        const std::int64_t count = block_.last.x + 1;
        for (std::int64_t z = 0; z <= block_.last.z; ++z) {
            for (std::int64_t y = 0; y <= block_.last.y; ++y) {
                f(block_.layout.row(static_cast<std::uint32_t>(y), static_cast<std::uint32_t>(z)),
                  block_.corner + Int3{0, y, z}, count);
            }
        }
    }

    void gather(const Int3& corner) {
        const Int3 last = common_.nodes->nodes() - Int3{1, 1, 1} - corner;
        const Int3 whole = Int3{1, 1, 1} * common_.cells;
        block_.corner = corner;
        block_.last = min(last, whole);
        for (int axis = 0; axis < 3; ++axis) {
            if ((common_.flat >> static_cast<unsigned>(axis) & 1U) != 0) {
                block_.last[axis] = 0;
            }
        }
        const Int3 reached = max(block_.last, Int3{(common_.flat & 1U) != 0 ? whole.x : 0,
                                                   (common_.flat & 2U) != 0 ? whole.y : 0,
                                                   (common_.flat & 4U) != 0 ? whole.z : 0});
        block_.is_cut = reached != whole;
        std::fill(block_.active.begin(), block_.active.end(), Real{0});
        std::fill(block_.value.begin(), block_.value.end(), Real{0});
        std::fill(block_.sum.begin(), block_.sum.end(), Real{0});
        if constexpr (Coefficient) {
            std::fill(block_.stopping.begin(), block_.stopping.end(), Real{0});
        }
        row_has_.clear();
        block_.is_full = true;
        for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            const std::uint64_t number = common_.nodes->number_from(p);
            if (count <= 64 && common_.nodes->contains_row(p, count)) {
                gather_row(first, number, static_cast<std::uint32_t>(count));
                row_has_.push_back(1);
                return;
            }
            std::uint8_t has = 0;
            bool all = true;
            std::int64_t next = p.x;
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t n) {
                const std::uint32_t at =
                    first + block_.layout.in_row(static_cast<std::uint32_t>(x - p.x));
                block_.active[at] = 1;
                if constexpr (kHasValue) {
                    block_.value[at] = common_.value[n];
                }
                if constexpr (Coefficient) {
                    block_.stopping[at] = common_.stopping[n];
                }
                has = 1;
                all = all && x == next;
                ++next;
            });
            row_has_.push_back(has);
            block_.is_full = block_.is_full && all && next == p.x + count;
        });
    }
    /// The same where all are active.
    void gather_row(std::uint32_t first, std::uint64_t number, std::uint32_t count) {
        const auto split = [&](const Real* from, Real* to) {
            Real* const odd = to + BlockLayout<D>::kEven;
            for (std::uint32_t i = 0; i < count / 2; ++i) {
                to[i] = from[2 * i];
                odd[i] = from[2 * i + 1];
            }
            if (count % 2 != 0) {
                to[count / 2] = from[count - 1];
            }
        };
        Real* const active = block_.active.data() + first;
        std::fill(active, active + (count + 1) / 2, Real{1});
        std::fill(active + BlockLayout<D>::kEven, active + BlockLayout<D>::kEven + count / 2,
                  Real{1});
        if constexpr (kHasValue) {
            split(common_.value.data() + number, block_.value.data() + first);
        }
        if constexpr (Coefficient) {
            split(common_.stopping.data() + number, block_.stopping.data() + first);
        }
    }

    /// The finest elements, in space.
    void finest() {
        const ElementTerms<Real>& t = common_.terms[0][0];
        const FinestTerms<Real> terms{t.volume, t.stiffness, t.inverse, t.inverse_lambda};
        std::array<std::array<Real, kCellsPerCall>, 2> there{};
        for (std::size_t parity = 0; parity < 2; ++parity) {
            for (std::size_t i = 0; i < kCellsPerCall; ++i) {
                there.at(parity).at(i) =
                    static_cast<std::int64_t>(2 * i + parity) < block_.last.x ? 1 : 0;
            }
        }
        const auto rows = static_cast<std::size_t>(block_.last.y + 1);
        for (std::int64_t z = 0; z < block_.last.z; ++z) {
            for (std::int64_t y = 0; y < block_.last.y; ++y) {
                std::array<std::uint32_t, 4> first{};
                std::array<bool, 4> has{};
                for (unsigned r = 0; r < 4; ++r) {
                    // The node with this parity of the two.
                    const std::int64_t at_y = y + ((y & 1) != static_cast<std::int64_t>(r & 1U));
                    const std::int64_t at_z = z + ((z & 1) != static_cast<std::int64_t>(r >> 1U));
                    first.at(r) = block_.layout.row(static_cast<std::uint32_t>(at_y),
                                                    static_cast<std::uint32_t>(at_z));
                    has.at(r) = row_has_[static_cast<std::size_t>(at_z) * rows +
                                         static_cast<std::size_t>(at_y)] != 0;
                }
                if (!has[0] && !has[1] && !has[2]) {
                    continue;
                }
                for (std::uint32_t parity = 0; parity < 2; ++parity) {
                    add_cells(terms, first, parity, there.at(parity).data());
                }
            }
        }
    }
    void add_cells(const FinestTerms<Real>& terms, const std::array<std::uint32_t, 4>& first,
                   std::uint32_t parity, const Real* there) {
        const auto rows = [&](const std::vector<Real>& a) {
            CornerRows<Real> out;
            for (std::size_t r = 0; r < 4; ++r) {
                out[r] = {a.data() + first[r] + parity,
                          a.data() + first[r] + BlockLayout<D>::kEven};
            }
            return out;
        };
        std::array<SumRow<Real>, 4> sums;
        for (std::size_t r = 0; r < 4; ++r) {
            sums[r] = {block_.sum.data() + first[r] + parity,
                       block_.sum.data() + first[r] + BlockLayout<D>::kEven};
        }
        if constexpr (std::is_same_v<Real, float> && Work == ElementWork::stiffness) {
            if constexpr (Coefficient) {
                add_finest_products(terms, rows(block_.value), rows(block_.stopping),
                                    rows(block_.active), there, sums);
            } else {
                add_finest_products(terms, rows(block_.value), rows(block_.active), there, sums);
            }
        } else {
            add_finest<Work, Coefficient>(terms, rows(block_.value), rows(block_.stopping),
                                          rows(block_.active), there, sums);
        }
    }

    void visit(const Int3& corner, std::uint32_t elements) {
        BlockElements<Work, Coefficient, Real, D> leaves(block_, common_.terms);
        Int3 even{0, 0, 0};
        for (int axis = 0; axis < 3; ++axis) {
            even[axis] = (corner[axis] / common_.cells & 1) != 0 ? common_.cells : 0;
        }
        for (std::size_t walk = 0; walk < common_.walks.size(); ++walk) {
            if ((elements >> walk & 1U) != 0) {
                leaves.walk(even, common_.walks[walk], common_.cells, common_.level);
            }
        }
    }

    void scatter() {
        for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            const Real* const sum = block_.sum.data() + first;
            if (count <= 64 && common_.nodes->contains_row(p, count)) {
                Real* const to = common_.sum.data() + common_.nodes->number_from(p);
                const Real* const odd = sum + BlockLayout<D>::kEven;
                for (std::int64_t i = 0; i < count / 2; ++i) {
                    to[2 * i] += sum[i];
                    to[2 * i + 1] += odd[i];
                }
                if (count % 2 != 0) {
                    to[count - 1] += sum[count / 2];
                }
                return;
            }
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t n) {
                common_.sum[n] += sum[block_.layout.in_row(static_cast<std::uint32_t>(x - p.x))];
            });
        });
    }

    const Common& common_;
    LocalBlock<Real, D> block_;
    std::vector<std::uint8_t> row_has_;  ///< whether a row has an active node
};

}  // namespace isonest::detail
